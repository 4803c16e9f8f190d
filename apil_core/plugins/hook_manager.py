"""The hook manager of one run: the method, its requirements, the observers; attribution of errors."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

import pluggy

from apil_core.api.hooks import PROJECT
from apil_core.api.hookspecs import ProcessHooks, RunHooks
from apil_core.api.specs import MethodSpec, load
from apil_core.common.errors import ApilError, PluginError, failures
from apil_core.plugins.validation import register, remarks

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from apil_core.api.types import Rollout

_Kind = TypeVar("_Kind")


class RunHookManager:
    """Holds the plugins of one run; ``hook`` is pluggy's caller namespace.

    All hook specifications (the core's, then each method's own) are added before anything is
    registered, so that a method may implement hooks that another one defines, in any order.

    Args:
        chain: the method's specs, requirements first.
        plugins: name → object with hook implementations, in the order to register.

    Attributes:
        device: where tensors that hooks return must live; ``None``: not checked.
        white_box: the method, or one it requires, may see inside the victim.

    Raises:
        PluginError: an implementation fits no hook, or takes arguments the hook does not have.
    """

    def __init__(self, chain: Sequence[MethodSpec], plugins: Mapping[str, Any]):
        self.plugins = dict(plugins)
        self.white_box = any(spec.white_box for spec in chain)
        self.device: torch.device | None = None
        self._watched = False
        self.manager = pluggy.PluginManager(PROJECT)
        self.manager.add_hookspecs(RunHooks)
        self.manager.add_hookspecs(ProcessHooks)  # observers are whole plugin modules
        for spec in chain:
            if spec.hookspecs:
                self._open(spec)
        for name, plugin in plugins.items():
            self._register(name, plugin)

    def of(self, kind: type[_Kind]) -> dict[str, _Kind]:
        """The plugins of a class, by name: ``RunPlugin`` for all with a state, ``Observer`` for observers."""
        return {name: plugin for name, plugin in self.plugins.items() if isinstance(plugin, kind)}

    @property
    def hook(self) -> Any:
        """Call ``hook.<name>(keyword=...)``; plugins registered last are called first."""
        return self.manager.hook

    def merged(self, answers: Sequence[Mapping[str, Any] | None], hook: str) -> dict[str, Any]:
        """One dict from the answers of several plugins, first registered first.

        Raises:
            PluginError: an answer is no dict, or two plugins use one name.
        """
        merged: dict[str, Any] = {}
        for answer in reversed(answers):  # pluggy lists the last registered first
            if not isinstance(answer, Mapping):
                raise self.plugin_error(hook, f"must return a dict or None, got {type(answer).__name__}")
            for name, value in answer.items():
                if not isinstance(name, str):
                    raise self.plugin_error(hook, f"names must be strings, got {short_repr(name)}")
                if name in merged:
                    raise self.plugin_error(hook, f"{name!r} is returned twice; names must differ")
                merged[name] = value
        return merged

    def implements(self, hook: str) -> bool:
        """True if any plugin of this run implements ``hook`` (to skip work that none would use)."""
        return bool(getattr(self.manager.hook, hook).get_hookimpls())

    def asks_for(self, argument: str) -> bool:
        """True if a hook implementation of this run takes ``argument`` (to skip what none would read)."""
        callers = vars(self.manager.hook).values()
        return any(argument in impl.argnames for caller in callers for impl in caller.get_hookimpls())

    def callers(self, hook: str) -> dict[str, Any]:
        """Plugins that implement ``hook`` → a caller of that plugin alone, in order of registration.

        Raises:
            PluginError: a plugin wraps the hook: called one by one, there is nothing to wrap.
        """
        impls = getattr(self.manager.hook, hook).get_hookimpls()
        wrapper = next((impl for impl in impls if impl.wrapper or impl.hookwrapper), None)
        if wrapper is not None:
            reason = f"{hook} cannot be wrapped: each plugin gets what the one before it returned"
            raise PluginError(f"plugin {wrapper.plugin_name!r} cannot be used: {reason}")
        fillers = {impl.plugin_name for impl in impls}
        return {
            name: getattr(self.only(plugin), hook) for name, plugin in self.plugins.items() if name in fillers
        }

    def plugin_error(self, hook: str, text: str, by: str | None = None) -> PluginError:
        """An error about the result of ``hook``, with the name of the plugin or of all that implement it."""
        impls = getattr(self.manager.hook, hook).get_hookimpls()
        fillers = [by] if by else [impl.plugin_name for impl in impls]
        return PluginError(f"{hook} (filled by {', '.join(fillers)}): {text}")

    def checked(
        self, hook: str, name: str, value: Any, shape: tuple[int, ...], by: str | None = None
    ) -> Tensor:
        """``value`` without its graph, if it is a float32 tensor of that shape without NaN or infinities.

        Results of plugins are never differentiated: their graph would only use memory.

        Args:
            hook: what it was returned by.
            name: of the value, if it is one of several.
            value: what was returned.
            shape: what it must have.
            by: the plugin that returned it, where that is known.

        Raises:
            PluginError: it is not; the message names ``by``, or the plugins that implement ``hook``.
        """
        import torch

        from apil_core.common.tensors import all_finite

        label = f"{name!r} must be" if name else "must return"
        if not isinstance(value, torch.Tensor):
            raise self.plugin_error(hook, f"{label} a tensor {shape} float32, got {short_repr(value)}", by)
        if value.shape != shape or value.dtype != torch.float32:
            got = f"{tuple(value.shape)} {str(value.dtype).removeprefix('torch.')}"
            raise self.plugin_error(hook, f"{label} {shape} float32, got {got}", by)
        if self.device is not None and not _lives_on(value, self.device):
            raise self.plugin_error(hook, f"{label} on {self.device}, got one on {value.device}", by)
        value = value.detach() if value.requires_grad else value
        if not all_finite(value):
            raise self.plugin_error(hook, f"{label} finite, got NaN or infinite values", by)
        return value

    def notes(self) -> list[str]:
        """Warnings about the plugins, one line each."""
        return [
            f"plugin {name!r}: {line}"
            for name, plugin in self.plugins.items()
            for line in remarks(self.manager, name, plugin)
        ]

    @contextmanager
    def arguments_unchanged(self) -> Iterator[None]:
        """Compare every hook's arguments before and after the call; costs copies: for the start of a run.

        Raises:
            PluginError: a hook changed a tensor argument; names the plugins called, and the tensor.
        """
        from apil_core.plugins.unchanged import changed, copies

        before: list[Mapping[str, Tensor]] = []  # hooks may call hooks

        def keep(hook: str, implementations: Sequence[pluggy.HookImpl], arguments: Mapping[str, Any]) -> None:
            before.append(copies(arguments))

        def compare(
            outcome: pluggy.Result[Any],
            hook: str,
            implementations: Sequence[pluggy.HookImpl],
            arguments: Mapping[str, Any],
        ) -> None:
            paths = changed(before.pop(), arguments)
            if paths and outcome.exception is None:
                asked = ", ".join(dict.fromkeys(i.plugin_name for i in implementations))
                text = f"changed {paths[0]} in place; work on a copy, others are handed the same"
                raise self.plugin_error(hook, text, asked)

        undo = self.manager.add_hookcall_monitoring(keep, compare)
        self._watched = True
        try:
            yield
        finally:
            self._watched = False
            undo()

    def finished(self, name: str, work: Callable[[], Any], rollout: Rollout) -> dict[str, Any]:
        """Call a function that ``update_auxiliary`` returned, with the same checks as hooks.

        Args:
            name: of the plugin.
            work: the function.
            rollout: argument of the hook.

        Raises:
            PluginError: it failed, changed the rollout in place, or returned no dict.
        """
        from apil_core.plugins.unchanged import changed, copies

        before = copies({"rollout": rollout}) if self._watched else None
        try:
            answer = work()
        except ApilError:
            raise
        except failures() as error:
            raise self._failure(error, (name, "update_auxiliary")) from error
        paths = [] if before is None else changed(before, {"rollout": rollout})
        if paths:
            text = f"changed {paths[0]} in place; work on a copy, others are handed the same"
            raise self.plugin_error("update_auxiliary", text, name)
        return {} if answer is None else self.merged([answer], "update_auxiliary")

    def only(self, plugin: Any) -> Any:
        """A caller namespace of ``plugin`` alone."""
        others = [other for other in self.plugins.values() if other is not plugin]
        return _Subset(self.manager, others)

    def without(self, plugins: Collection[Any]) -> Any:
        """A caller namespace that excludes ``plugins``."""
        return _Subset(self.manager, list(plugins))

    @contextmanager
    def attribution(self) -> Iterator[None]:
        """Re-raise an exception that came out of a plugin's hook as ``PluginError`` with its name."""
        try:
            yield
        except ApilError:
            raise
        except failures() as error:
            if self._culprit(error.__traceback__) is None:
                raise
            raise self._failure(error) from error

    def _open(self, spec: MethodSpec) -> None:
        try:
            self.manager.add_hookspecs(load(spec.hookspecs or "", f"method {spec.name!r}"))
        except ValueError as error:  # pluggy's, for a module without any
            reason = f"its hookspecs {spec.hookspecs!r} has no function marked with hookspec"
            raise PluginError(f"plugin {spec.name!r} cannot be used: {reason}") from error

    def _register(self, name: str, plugin: Any) -> None:
        from apil_core.api.method import Observer

        try:
            if isinstance(plugin, Observer):  # used with any method: must not need one method's hooks
                alone = pluggy.PluginManager(PROJECT)
                alone.add_hookspecs(RunHooks)
                register(alone, name, plugin)
            register(self.manager, name, plugin)
        except PluginError as error:
            raise PluginError(f"plugin {name!r} cannot be used: {error}") from error

    def _failure(self, error: BaseException, otherwise: tuple[str, str] = ("", "")) -> PluginError:
        """Error that names the plugin; ``otherwise`` if no hook implementation is on the stack."""
        name, hook, where = self._culprit(error.__traceback__) or (*otherwise, "")
        reason = " ".join(str(error).split())
        return PluginError(f"plugin {name!r} failed in {hook}: {type(error).__name__}: {reason}{where}")

    def _culprit(self, traceback: TracebackType | None) -> tuple[str, str, str] | None:
        """The innermost hook implementation on the stack: plugin, hook, and `` (FILE:LINE)`` in its file."""
        owners = {
            impl.function.__code__: (impl.plugin_name, name)
            for name in vars(self.manager.hook)
            for impl in getattr(self.manager.hook, name).get_hookimpls()
            if hasattr(impl.function, "__code__")
        }
        found, file, line = None, "", 0
        while traceback is not None:
            code = traceback.tb_frame.f_code
            if code in owners:
                found, file = owners[code], code.co_filename
            if code.co_filename == file:
                line = traceback.tb_lineno
            traceback = traceback.tb_next
        return found and (*found, f" ({file}:{line})")


def short_repr(value: Any) -> str:
    """A value in a message: short ones as they are, others by their type."""
    if isinstance(value, (str, int, float, type(None))):
        return reprlib.repr(value)
    return type(value).__name__


def _lives_on(value: Tensor, device: torch.device) -> bool:
    here = value.device
    return (here.type == device.type and None in (here.index, device.index)) or here == device


class _Subset:
    """``hook``-like access that excludes some plugins."""

    def __init__(self, manager: pluggy.PluginManager, left_out: Sequence[Any]):
        self._manager = manager
        self._left_out = left_out

    def __getattr__(self, name: str) -> Any:
        return self._manager.subset_hook_caller(name, self._left_out)
