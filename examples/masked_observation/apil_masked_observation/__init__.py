"""A defence: the victim's observation of its opponent is masked."""

from __future__ import annotations

from apil_core import ObserverSpec, hookimpl

__all__ = ["APIL_HOOK_API", "register_observers"]

APIL_HOOK_API = 2
"""The hook API this package was written for."""


@hookimpl
def register_observers() -> list[ObserverSpec]:
    """Register an observer: it can be switched on with any attack method."""
    return [
        ObserverSpec(
            name="masked_observation",
            factory="apil_masked_observation.observer:MaskedObservation",
            summary="a defence: the victim does not see its opponent",
            config="apil_masked_observation.options:MaskedObservationOptions",
            reference="Gleave et al. 2020, arXiv:1905.10615",
        )
    ]
