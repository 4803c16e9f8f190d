/* Makes theme, selectors, copies, contents and print work. */
(() => {
  "use strict";
  const root = document.documentElement;
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  /* theme */
  const system = matchMedia("(prefers-color-scheme: dark)");
  const remember = { get: () => { try { return localStorage.getItem("apil-theme"); } catch { return null; } },
                     set: (value) => { try { localStorage.setItem("apil-theme", value); } catch { /* private window */ } } };
  const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  const toggle = document.getElementById("theme");
  const label = () => { toggle.textContent = dark() ? "Light colours" : "Dark colours"; };
  if (remember.get()) root.dataset.theme = remember.get();
  toggle.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    remember.set(root.dataset.theme);
    label();
  });
  system.addEventListener("change", label);

  /* selectors: a figure is shown if every selector of its section lets it */
  const filter = (form) => {
    const wanted = all("input:checked", form).map((input) => [input.dataset.facet, input.value]);
    const section = form.closest("section");
    const figures = all("figure[data-facets]", section);
    for (const figure of figures) {
      const facets = JSON.parse(figure.dataset.facets);
      figure.hidden = !wanted.every(([name, value]) => value === "" || value.split("|").includes(facets[name]));
    }
    const shown = figures.filter((figure) => !figure.hidden);
    all(".figures", section).forEach((grid) => grid.classList.toggle("single", shown.length === 1));
    all(".none-left", section).forEach((line) => { line.hidden = shown.length > 0; });
  };
  for (const form of all("form.selectors")) form.addEventListener("change", () => filter(form));

  /* copies of tables */
  const say = (button, words) => {
    const before = button.dataset.label || (button.dataset.label = button.textContent);
    button.textContent = words;
    document.getElementById("said").textContent = words;
    setTimeout(() => { button.textContent = before; }, 1500);
  };
  const byHand = (text) => {
    const area = document.body.appendChild(document.createElement("textarea"));
    area.value = text;
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    if (!done) throw new Error("not allowed");
  };
  for (const button of all("button.copier"))
    button.addEventListener("click", async () => {
      const text = document.getElementById(button.dataset.of).textContent;
      try {
        try { await navigator.clipboard.writeText(text); } catch { byHand(text); }
        say(button, "Copied");
      } catch { say(button, "Select and copy it below"); }
    });
  for (const button of all("button.saver"))
    button.addEventListener("click", () => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([document.getElementById(button.dataset.of).textContent], { type: "text/plain" }));
      link.download = button.dataset.file;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
      say(button, "Saved");
    });

  /* print: with everything opened; colours and figures are the style sheet's */
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = all("details:not([open]):not(.screen)");
    opened.forEach((details) => { details.open = true; });
  });
  addEventListener("afterprint", () => { opened.forEach((details) => { details.open = false; }); });

  /* where one is */
  const links = new Map(all(".contents a").map((link) => [link.hash.slice(1), link]));
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting || !links.has(entry.target.id)) continue;
      links.forEach((link) => link.removeAttribute("aria-current"));
      links.get(entry.target.id).setAttribute("aria-current", "true");
    }
  }, { rootMargin: "-10% 0px -75% 0px" });
  all("section[id]").forEach((section) => seen.observe(section));

  /* a link to the warnings opens them */
  const unfold = () => { const place = document.getElementById(location.hash.slice(1)); if (place?.matches("details")) place.open = true; };
  addEventListener("hashchange", unfold);

  unfold();
  label();
  all("form.selectors").forEach((form) => form.reset());
  all("form.selectors").forEach(filter);
  root.dataset.ready = "true";
})();
