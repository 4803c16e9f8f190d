"""The adversary as a policy: methods' extra observations, normaliser and actor, with or without a run."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from apil_core.api.method import RunPlugin
from apil_core.api.policy import Policy, PolicyInfo
from apil_core.api.types import OWN_GROUP, PRIVILEGED_GROUP, Context, Decision, View
from apil_core.common.errors import PluginError
from apil_core.common.seeds import stream_seed
from apil_core.plugins.hook_manager import RunHookManager, short_repr
from apil_core.training.normalize import ObservationNormalizer
from apil_core.training.ppo import Actor

HOOK_STREAM = "evaluation hooks"
"""Random stream of stochastic hooks where there is no run."""


class ObservationBuilder(nn.Module):
    """Builder of the learner's input from a view: own observation, the hooks' groups, each normalised.

    Group sizes are set by the first view and checked afterwards.

    Args:
        hooks: called for ``extend_observation``.
        clip: bound of the normalised values.
    """

    def __init__(self, hooks: RunHookManager, clip: float):
        super().__init__()
        self._hooks = hooks
        self._clip = clip
        self.normalizers = nn.ModuleDict()

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each group, in order of concatenation; empty before the first view."""
        return {name: self._normalizer(name).shift.numel() for name in self.normalizers}

    def groups(self, context: Context, view: View) -> dict[str, Tensor]:
        """Raw groups, each (n, k).

        Raises:
            PluginError: a group has another shape or type than (n, k) float32, or changed its size.
        """
        groups = self.unchecked_groups(context, view)
        if not self.normalizers:
            widths = {name: self._width(name, value) for name, value in groups.items()}
            self.add_normalizers(widths, view.own.device)
        sizes = self.sizes
        if list(groups) != list(sizes):
            raise self._complaint(f"groups changed from {list(sizes)} to {list(groups)}")
        for name, value in groups.items():
            if name != OWN_GROUP:
                shape = (len(view.own), sizes[name])
                groups[name] = self._hooks.checked("extend_observation", name, value, shape)
        return groups

    def unchecked_groups(self, context: Context, view: View) -> dict[str, Tensor]:
        """:meth:`groups` by tensor operators alone, so that torch can trace it; values are not checked."""
        answers = self._hooks.hook.extend_observation(context=context, view=view)
        groups = {OWN_GROUP: view.own}
        for name, value in self._hooks.merged(answers, "extend_observation").items():
            if name in (OWN_GROUP, PRIVILEGED_GROUP):
                raise self._complaint(f"the name {name!r} is taken; choose another")
            groups[name] = value
        return groups

    def add_normalizers(self, sizes: dict[str, int], device: torch.device) -> None:
        """Set the group sizes (when loading a policy)."""
        # the first view is in inference mode, whose tensors could not be loaded into later
        with torch.inference_mode(False):
            for name, size in sizes.items():
                try:
                    self.normalizers[name] = ObservationNormalizer(size, self._clip).to(device)
                except KeyError as error:  # torch registers modules assigned as attributes
                    raise self._complaint(f"no group can be named {name!r}; choose another") from error

    def normalize(self, groups: dict[str, Tensor], *, update: bool) -> TensorDict:
        """Normalised groups, batch (n,); ``update`` also takes them into the statistics."""
        result = {}
        for name, value in groups.items():
            normalizer = self._normalizer(name)
            if update:
                normalizer.update(value)
            result[name] = normalizer(value)
        some = next(iter(groups.values()))
        return TensorDict(result, batch_size=[some.shape[0]], device=some.device)

    def _normalizer(self, name: str) -> ObservationNormalizer:
        module = self.normalizers[name]
        assert isinstance(module, ObservationNormalizer)
        return module

    def _width(self, name: str, value: Any) -> int:
        if not isinstance(value, Tensor) or value.ndim != 2:
            got = tuple(value.shape) if isinstance(value, Tensor) else short_repr(value)
            raise self._complaint(f"{name!r} must have shape (num_envs, k), got {got}")
        return value.shape[1]

    def _complaint(self, text: str) -> PluginError:
        return self._hooks.plugin_error("extend_observation", text)


class AdversaryPolicy(Policy):
    """A trained (or training) adversary that acts without a run.

    Args:
        info: identity; the hash is the checkpoint's.
        builder: of the observation; never updated here.
        actor: the policy network.
        context: of the observations; its generator is the random source of stochastic hooks.
        hooks: of the methods and observers, whose state belongs to the policy; their errors name the
            plugin.
    """

    def __init__(
        self,
        info: PolicyInfo,
        builder: ObservationBuilder,
        actor: Actor,
        context: Context,
        hooks: RunHookManager,
    ):
        self.info = info
        self.builder = builder
        self.actor = actor
        self.context = context
        self.hooks = hooks

    def act(
        self,
        view: View,
        *,
        sample: bool,
        generator: torch.Generator | None = None,
        activations: bool = False,
    ) -> Decision:
        """See :meth:`apil_core.Policy.act`."""
        with torch.inference_mode(), self.hooks.attribution():
            observations = self.builder.normalize(self.builder.groups(self.context, view), update=False)
            distribution = self.actor(observations)
            action = distribution.sample(generator) if sample else distribution.mean
            hidden = {"hidden": self.actor.hidden(observations)} if activations else None
        return Decision(action, distribution, hidden)

    def seed(self, seed: int) -> None:
        """Restart the generator that stochastic hooks draw from."""
        self.context.generator.manual_seed(stream_seed(seed, HOOK_STREAM))

    def recurrent_state(self) -> dict[str, Any]:
        """State of the hooks' generator, of methods and of observers."""
        with self.hooks.attribution():
            states = {name: plugin.state_dict() for name, plugin in self.hooks.of(RunPlugin).items()}
        return {"generator": self.context.generator.get_state(), "methods": states}

    def load_recurrent_state(self, state: dict[str, Any]) -> None:
        """Restore the result of :meth:`recurrent_state`; there is no other state between games."""
        if not state:
            return
        self.context.generator.set_state(state["generator"].cpu())
        with self.hooks.attribution():
            for name, plugin in self.hooks.of(RunPlugin).items():
                plugin.load_state_dict(state["methods"][name])
