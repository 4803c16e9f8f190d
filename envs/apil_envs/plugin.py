"""What this package registers: its games and its scripted victim. Imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core import GameSpec, PolicySpec, RewardWeights, hookimpl


@hookimpl
def register_games() -> list[GameSpec]:
    """The games of Bansal et al. 2018 that exist so far, and a toy for quick trials and tests."""
    return [
        GameSpec(
            name="kick-and-defend",
            factory="apil_envs.kick_and_defend:KickAndDefend",
            summary="a humanoid kicks a ball at a goal that another one keeps",
            sides=("kicker", "keeper"),
            victim_side=0,
            default_victim="zoo:kick-and-defend/kicker/v1",
            baseline_adversary="zoo:kick-and-defend/defender/v1",
            config="apil_envs.options:KickAndDefendOptions",
        ),
        GameSpec(
            name="toy-pursuit",
            factory="apil_envs.toy:ToyPursuit",
            summary="a point chases another one in a disc; learnt in a minute, needs no MuJoCo",
            sides=("evader", "pursuer"),
            victim_side=0,
            default_victim="scripted:toy-pursuit/evader/v1",
            rewards=RewardWeights(),
            config="apil_envs.toy:ToyPursuitOptions",
        ),
    ]


@hookimpl
def register_policies() -> list[PolicySpec]:
    """Policies written by hand, named ``scripted:<game>/<side>/<version>``."""
    return [
        PolicySpec(
            scheme="scripted",
            loader="apil_envs.scripted:load_scripted",
            lister="apil_envs.scripted:list_scripted",
            summary="policies written by hand (toy-pursuit)",
        )
    ]
