"""The Python reference: a page per group of public names, from docstrings; griffe reads, imports nothing."""

from __future__ import annotations

import re
from functools import cache

import griffe
from site_sources import ROOT, SiteError

GROUPS = {
    "session": (
        "Sessions",
        "Train, score and compare from Python; examples: [from Python](../python.md). A callback's hooks: "
        "[hooks](../hooks.md).",
        "run resume run_seeds RunResult Callback define load_run LoadedRun plot_runs Media evaluate "
        "EvaluationResult crossplay retrain resume_retraining distill export tune TuneResult",
    ),
    "configuration": (
        "Configurations",
        "The settings of a run as models; every key with its bounds: [every setting](../settings.md).",
        "RunConfig PPOConfig RewardConfig EvaluationConfig CheckpointConfig Section ProfiledOptions absent",
    ),
    "methods": (
        "Methods and observers",
        "What a plugin derives from and registers. Its hooks: [hooks](../hooks.md).",
        "Method Observer RunPlugin Run MethodSetup MethodSpec RewardWeights ObserverSpec RecorderSpec "
        "hookimpl hookspec HOOK_API Deprecation",
    ),
    "types": (
        "Data of hooks",
        "What hooks and policies are given and return.",
        "StepBatch Rollout View Context Decision DiagonalGaussian",
    ),
    "learning": (
        "Networks and learning",
        "Parts of the learner, for methods that train networks of their own.",
        "mlp GaussianActor RunningMoments ObservationNormalizer ReturnNormalizer gae normalize_advantages",
    ),
    "games": (
        "Games",
        "The batched game, what a plugin registers about it, and PettingZoo's games; "
        "tutorial: [bring a game](../tutorial/bring-a-game.md).",
        "Game GameLayout SideLayout GameStep NO_WINNER Window PhysicsStopwatch Colour GameSpec Matchup "
        "PublishedScore make_game pettingzoo_spec PettingZooOptions",
    ),
    "environments": (
        "Environments for other learners",
        "The games as Gymnasium, PettingZoo and Stable-Baselines3 environments; "
        "examples: [vector environments](../vector-environments.md).",
        "GameVectorEnv sb3_vec_env OpponentInsideEnv ParallelGameEnv",
    ),
    "policies": (
        "Policies",
        "Victims and adversaries that are not learning; names: [victims](../victims.md).",
        "Policy PolicyInfo PolicySpec PolicyListing load_policy FrozenPolicy NetworkShape PolicyNetwork "
        "save_policy check_policy Conformance read_pickle Opaque",
    ),
    "errors": (
        "Errors and processes",
        "What is raised on bad input, trust in files that hold code, and threads.",
        "ApilError ConfigError PluginError RunDirError UnknownNameError VictimError trust side_by_side",
    ),
    "testing": (
        "Checks for plugins",
        "`apil_core.testing`; every check, and the pytest fixtures: [testing](../testing.md).",
        "check_method check_game check_victim tiny_config tiny_run MethodReport GameReport VictimReport "
        "ContractError",
    ),
}
"""Page → title, introduction, names."""

_PAGE_OF = {name: page for page, (_, _, names) in GROUPS.items() for name in names.split()}


def reference_pages(public: set[str]) -> dict[str, str]:
    """Pages of the reference by place on the site, with an index of all names.

    Args:
        public: ``__all__`` of ``apil_core`` and of ``apil_core.testing``.

    Raises:
        SiteError: a public name is in no group, or a group names what is not public.
    """
    if wrong := sorted(public ^ set(_PAGE_OF)):
        raise SiteError(f"docs/site/site_python.py: GROUPS and __all__ differ in {', '.join(wrong)}")
    pages, index = {}, ["# Python reference\n\nEvery public name ([what that means](../stability.md)).\n"]
    for page, (title, introduction, listed) in GROUPS.items():
        names = listed.split()
        pages[f"reference/{page}.md"] = f"# {title}\n\n{introduction}\n\n" + "\n".join(map(_entry, names))
        rows = (f"| [`{name}`]({page}.md#{name.lower()}) | {_summary(name)} |\n" for name in names)
        index.append(f"\n## {title}\n\n| name | |\n|---|---|\n{''.join(rows)}")
    return {"reference/index.md": "".join(index), **pages}


@cache
def _modules() -> tuple[griffe.Module, griffe.Module]:
    loader = griffe.GriffeLoader(
        search_paths=[ROOT],
        allow_inspection=False,
        docstring_parser="google",
        docstring_options={"warnings": False},
        extensions=griffe.load_extensions("dataclasses"),
    )
    package = loader.load("apil_core")
    return package, package["testing"]


def _object(name: str) -> griffe.Object:
    found = _modules()[_PAGE_OF[name] == "testing"][name]
    return found.final_target if found.is_alias else found


def _summary(name: str) -> str:
    text = _object(name).docstring
    return _prose(text.value.partition("\n\n")[0], name).replace("|", "\\|") if text else ""


def _entry(name: str) -> str:
    """One public name: its signature, its docstring, and its members that have docstrings."""
    found = _object(name)
    text = f"## `{name}`\n\n```python\n{_signature(found, name)}\n```\n\n{_described(found, name)}"
    if not found.is_class:
        return text
    members = [m for m in found.members.values() if m.name[0] != "_" and not m.is_alias and m.docstring]
    if attributes := [m for m in members if m.is_attribute and f"- `{m.name}`" not in text]:
        text += "**Properties**\n\n" if "**Attributes**" in text else "**Attributes**\n\n"
        text += "".join(_item(m.name, m.annotation, _prose(m.docstring.value, name)) for m in attributes)
        text += "\n"
    for member in members:
        if member.is_function:
            shown = f"{name}.{member.name}"
            text += (
                f"### `{shown}`\n\n```python\n{_signature(member, shown)}\n```\n\n{_described(member, name)}"
            )
    return text


def _signature(found: griffe.Object, name: str) -> str:
    if found.is_attribute:
        return f"{name} = {found.value}"
    if found.is_class:
        own = "dataclass" in found.labels or "__init__" in found.members
        if not own:
            bases = ", ".join(map(str, found.bases))
            return f"class {name}({bases})" if bases else f"class {name}"
        text = f"class {found.signature(name=name)}"
    else:
        text = found.signature(name=name)
    text = re.sub(r"\((self|cls)(, |(?=\)))", "(", text, count=1)
    return text if len(text) <= 88 else _one_a_line(text)


def _one_a_line(signature: str) -> str:
    """The signature with each parameter on a line of its own."""
    depth, lines = 0, [""]
    for i, letter in enumerate(signature):
        depth -= letter in ")]}"
        if letter == ")" and not depth:
            return "\n    ".join(lines) + ",\n" + signature[i:]
        if letter == "," and depth == 1:
            lines[-1] += ","
            lines.append("")
        elif letter != " " or lines[-1] or depth != 1:
            lines[-1] += letter
        depth += letter in "([{"
        if letter == "(" and depth == 1:
            lines.append("")
    return signature


def _described(found: griffe.Object, owner: str) -> str:
    """The docstring as Markdown: prose, then lists of arguments, attributes, results and errors."""
    parts = []
    for section in found.docstring.parsed if found.docstring else ():
        if section.kind is griffe.DocstringSectionKind.text:
            parts.append(_prose(section.value, owner))
        elif section.kind is griffe.DocstringSectionKind.examples:
            raise SiteError(f"{found.path}: docstring section Examples is not rendered")
        elif section.kind is griffe.DocstringSectionKind.admonition:
            parts.append(f"**{section.title}**: {_prose(section.value.contents, owner)}")
        else:
            lines = (
                _item(getattr(each, "name", ""), each.annotation, _prose(each.description, owner))
                for each in section.value
            )
            parts.append(f"**{section.kind.value.capitalize()}**\n\n{''.join(lines)}".rstrip())
    return "".join(f"{part}\n\n" for part in parts)


def _item(name: str, annotation: object, text: str) -> str:
    if name.endswith(","):  # "reward, victim_reward: ...": griffe takes the second for a type
        name, annotation = f"{name} {annotation}".replace("(", "").replace(")", ""), None
    kind = re.sub(r"Annotated\[(.+?), \w+\(.*?\)\]", r"\1", f"`{annotation}`") if annotation else ""
    head = f"`{name}` ({kind})" if name and kind else f"`{name}`" if name else kind
    return f"- {head}: {' '.join(text.split())}\n"


def _prose(text: str, owner: str) -> str:
    """Docstring text as Markdown: roles and doubled backticks are code, linked if that is public."""
    text = re.sub(r":\w+:`[~.]*([^`]+)`", r"``:\1``", text)
    pieces = re.split(r"(``.+?``|`[^`]+`)", text, flags=re.S)
    return "".join(_code(p.strip("`"), owner) if i % 2 else _plain(p) for i, p in enumerate(pieces))


def _code(code: str, owner: str) -> str:
    role, code = code.startswith(":"), code.lstrip(":")
    code = re.sub(r"^apil_core\.(\w+\.)*(?=[A-Za-z_]\w*$)", "", code)
    if code == owner or code not in _PAGE_OF or (code.islower() and not role):  # `run` may be many things
        return f"`{code}`"
    return f"[`{code}`]({_PAGE_OF[code]}.md#{code.lower()})"


def _plain(text: str) -> str:
    text = re.sub(r"([*<\[\]])", r"\\\1", text)
    return re.sub(r"docs/([\w/-]+\.md)", _page_link, text)


def _page_link(match: re.Match[str]) -> str:
    known = (ROOT / match[0]).is_file()
    return f"[{match[0]}](../{match[1]})" if known else match[0]
