"""The hook manager of one run: the method, what it requires, the observers; and who is to blame."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any

import pluggy

from apil_core.errors import ApilError, PluginError
from apil_core.hooks import PROJECT
from apil_core.hookspecs import ProcessHooks, RunHooks
from apil_core.specs import MethodSpec, load

if TYPE_CHECKING:
    from torch import Tensor


class RunHookManager:
    """Holds the plugins of one run; ``hook`` is pluggy's caller namespace.

    All hook specifications (the core's, then each method's own) are added before anything is
    registered, so that a method may fill hooks that another one opens whatever the order.

    Args:
        chain: the method's specs, requirements first.
        plugins: name → object with hook implementations, in the order to register.

    Raises:
        PluginError: an implementation fits no hook, or takes arguments the hook does not offer.
    """

    def __init__(self, chain: Sequence[MethodSpec], plugins: Mapping[str, Any]):
        self.plugins = dict(plugins)
        self.manager = pluggy.PluginManager(PROJECT)
        self.manager.add_hookspecs(RunHooks)
        self.manager.add_hookspecs(ProcessHooks)  # observers are whole plugin modules
        for spec in chain:
            if spec.hookspecs:
                self.manager.add_hookspecs(load(spec.hookspecs))
        for name, plugin in plugins.items():
            self._register(name, plugin)

    @property
    def hook(self) -> Any:
        """Call ``hook.<name>(keyword=...)``; plugins registered last are asked first."""
        return self.manager.hook

    def merged(self, answers: Sequence[Mapping[str, Any] | None], hook: str) -> dict[str, Any]:
        """One dict from the answers of several plugins, first registered first.

        Raises:
            PluginError: an answer is no dict, or two plugins use one name.
        """
        merged: dict[str, Any] = {}
        for answer in reversed(answers):  # pluggy lists the last registered first
            if not isinstance(answer, Mapping):
                raise self.complaint(hook, f"must return a dict or None, got {type(answer).__name__}")
            for name, value in answer.items():
                if name in merged:
                    raise self.complaint(hook, f"{name!r} is returned twice; names must differ")
                merged[name] = value
        return merged

    def fills(self, hook: str) -> bool:
        """Whether any plugin of this run implements ``hook`` (to skip work that none would see)."""
        return bool(getattr(self.manager.hook, hook).get_hookimpls())

    def callers(self, hook: str) -> dict[str, Any]:
        """Those who fill ``hook`` → a caller that asks that plugin alone, in order of registration.

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

    def complaint(self, hook: str, text: str, by: str | None = None) -> PluginError:
        """An error about what ``hook`` returned, with the name of the culprit or of all who fill it."""
        impls = getattr(self.manager.hook, hook).get_hookimpls()
        fillers = [by] if by else [impl.plugin_name for impl in impls]
        return PluginError(f"{hook} (filled by {', '.join(fillers)}): {text}")

    def checked(
        self, hook: str, name: str, value: Any, shape: tuple[int, ...], by: str | None = None
    ) -> Tensor:
        """``value`` if it is a float32 tensor of that shape without NaN or infinities.

        Args:
            hook: what it was returned by.
            name: of the value, if it is one of several.
            value: what was returned.
            shape: what it must have.
            by: the plugin that returned it, where that is known.

        Raises:
            PluginError: it is not; the message names ``by``, or who fills ``hook``.
        """
        import torch

        from apil_core.finite import all_finite

        label = f"{name!r} must be" if name else "must return"
        if not isinstance(value, torch.Tensor):
            raise self.complaint(hook, f"{label} a tensor {shape} float32, got {value!r}", by)
        if value.shape != shape or value.dtype != torch.float32:
            got = f"{tuple(value.shape)} {str(value.dtype).removeprefix('torch.')}"
            raise self.complaint(hook, f"{label} {shape} float32, got {got}", by)
        if not all_finite(value):
            raise self.complaint(hook, f"{label} finite, got NaN or infinite values", by)
        return value

    def only(self, plugin: Any) -> Any:
        """A caller namespace that asks ``plugin`` alone."""
        others = [other for other in self.plugins.values() if other is not plugin]
        return _Subset(self.manager, others)

    def without(self, plugins: Collection[Any]) -> Any:
        """A caller namespace that leaves ``plugins`` out."""
        return _Subset(self.manager, list(plugins))

    @contextmanager
    def attribution(self) -> Iterator[None]:
        """Re-raise an exception that came out of a plugin's hook as ``PluginError`` with its name."""
        try:
            yield
        except ApilError:
            raise
        except Exception as error:
            culprit = self._culprit(error.__traceback__)
            if culprit is None:
                raise
            name, hook = culprit
            reason = " ".join(str(error).split())
            raise PluginError(
                f"plugin {name!r} failed in {hook}: {type(error).__name__}: {reason}"
            ) from error

    def _register(self, name: str, plugin: Any) -> None:
        try:
            self.manager.register(plugin, name=name)
            self.manager.check_pending()
        except (pluggy.PluginValidationError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise PluginError(f"plugin {name!r} cannot be used: {reason}") from error

    def _culprit(self, traceback: TracebackType | None) -> tuple[str, str] | None:
        """The innermost hook implementation on the stack: (plugin, hook)."""
        owners = {
            impl.function.__code__: (impl.plugin_name, name)
            for name in vars(self.manager.hook)
            for impl in getattr(self.manager.hook, name).get_hookimpls()
            if hasattr(impl.function, "__code__")
        }
        found = None
        while traceback is not None:
            found = owners.get(traceback.tb_frame.f_code, found)
            traceback = traceback.tb_next
        return found


class _Subset:
    """``hook``-like access that leaves some plugins out."""

    def __init__(self, manager: pluggy.PluginManager, left_out: Sequence[Any]):
        self._manager = manager
        self._left_out = left_out

    def __getattr__(self, name: str) -> Any:
        return self._manager.subset_hook_caller(name, self._left_out)
