/* Draws the figures in the theme's colours, and makes selectors, legends, copies, contents and print work. */
(() => {
  "use strict";
  const root = document.documentElement;
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const specs = JSON.parse(document.getElementById("figures").textContent);
  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
  const PRINT = { wide: 700, half: 340 };  // CSS pixels between the margins of A4
  const hidden = new Set();                // methods switched off in a legend
  let printing = false;

  /* colours */
  const probe = document.body.appendChild(document.createElement("span"));
  probe.hidden = true;
  const colour = (value) => {
    probe.style.color = value;
    return getComputedStyle(probe).color;
  };
  const resolved = (value) => {
    if (typeof value === "string") return value.startsWith("var(--") ? colour(value) : value;
    if (Array.isArray(value)) return value.map(resolved);
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, resolved(inner)]));
    return value;
  };

  /* figures */
  const draw = (plot) => {
    const { data, layout } = resolved(specs[plot.id]);
    for (const trace of data) if (trace.meta && hidden.has(trace.meta.method)) trace.visible = false;
    if (printing) layout.width = plot.closest(".single, .wide") ? PRINT.wide : PRINT.half;
    const name = plot.id.replace(/^figure-/, "");
    Plotly.newPlot(plot, data, layout, { ...config, responsive: !printing, toImageButtonOptions: { filename: name, scale: 2 } });
  };

  /* drawn when one comes near, and anew when colours or choices change */
  const near = new Set();
  const old = new Set(all(".plot"));
  const refresh = (plot) => { if (old.has(plot) && (printing || near.has(plot))) { old.delete(plot); draw(plot); } };
  const redraw = (within = document) => all(".plot", within).forEach((plot) => { old.add(plot); refresh(plot); });
  const watch = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting) near.add(target); else near.delete(target);
      refresh(target);
    }
  }, { rootMargin: "500px" });

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
    redraw();
  });
  system.addEventListener("change", () => { label(); if (!printing) redraw(); });

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
    redraw(section);
  };
  for (const form of all("form.selectors")) form.addEventListener("change", () => filter(form));

  /* legends switch methods off and on in every figure of the page */
  for (const button of all("button.method"))
    button.addEventListener("click", () => {
      const method = button.dataset.method;
      if (!hidden.delete(method)) hidden.add(method);
      for (const same of all("button.method"))
        if (same.dataset.method === method) same.setAttribute("aria-pressed", String(!hidden.has(method)));
      redraw();
    });

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

  /* print: everything, in light colours */
  let before = null;
  const enterPrint = () => {
    if (printing) return;
    printing = true;
    before = { theme: root.dataset.theme, figures: all("figure[hidden]"), details: all("details:not([open]):not(.screen)"),
               off: [...hidden] };
    root.dataset.theme = "light";
    hidden.clear();
    before.figures.forEach((figure) => { figure.hidden = false; });
    before.details.forEach((details) => { details.open = true; });
    redraw();
  };
  const leavePrint = () => {
    if (!printing) return;
    printing = false;
    if (before.theme) root.dataset.theme = before.theme; else delete root.dataset.theme;
    before.off.forEach((method) => hidden.add(method));
    before.figures.forEach((figure) => { figure.hidden = true; });
    before.details.forEach((details) => { details.open = false; });
    redraw();
  };
  addEventListener("beforeprint", enterPrint);
  addEventListener("afterprint", leavePrint);
  matchMedia("print").addEventListener("change", (event) => (event.matches ? enterPrint() : leavePrint()));

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

  label();
  all("form.selectors").forEach((form) => form.reset());
  all("form.selectors").forEach(filter);
  all(".plot").forEach((plot) => watch.observe(plot));
  root.dataset.ready = "true";
})();
