"""Plugin with this package's games and scripted victim. Imports neither torch nor mujoco."""

from __future__ import annotations

from apil_core import GameSpec, Matchup, PolicySpec, PublishedScore, RewardWeights, hookimpl

APIL_HOOK_API = 2


def _published(win: float, win_or_tie: float) -> PublishedScore:
    """A cell of the papers' baseline column; the action modes are those of its published evaluation code."""
    source = "Bui, Mai, Nguyen 2022, table 1, column Baseline"
    return PublishedScore(win, win_or_tie, 1000, source, adversary_actions="mode", victim_actions="mode")


_GAMES = [
    GameSpec(
        name="kick-and-defend",
        factory="apil_envs.kick_and_defend:KickAndDefend",
        summary="a humanoid kicks a ball at a goal that another one keeps",
        sides=("kicker", "keeper"),
        victim_side=0,
        default_victim="zoo:kick-and-defend/kicker/v1",
        fallback_victim="embedded:kick-and-defend/kicker/v1",
        baseline_adversary="zoo:kick-and-defend/defender/v1",
        config="apil_envs.options:KickAndDefendOptions",
        matchups=(
            Matchup("zoo:kick-and-defend/defender/v1", "zoo:kick-and-defend/kicker/v1", _published(28, 29)),
        ),
    ),
    GameSpec(
        name="you-shall-not-pass",
        factory="apil_envs.you_shall_not_pass:YouShallNotPass",
        summary="a humanoid runs for a line that another one keeps it from",
        sides=("blocker", "runner"),
        victim_side=1,
        default_victim="zoo:you-shall-not-pass/runner/v1",
        fallback_victim="embedded:you-shall-not-pass/runner/v1",
        baseline_adversary="zoo:you-shall-not-pass/blocker/v1",
        config="apil_envs.options:YouShallNotPassOptions",
        matchups=(
            Matchup(
                "zoo:you-shall-not-pass/blocker/v1",
                "zoo:you-shall-not-pass/runner/v1",
                _published(38, 38),
            ),
        ),
    ),
    GameSpec(
        name="sumo-humans",
        factory="apil_envs.sumo:SumoHumans",
        interchangeable_sides=True,
        summary="two humanoids push each other off a round platform",
        sides=("fighter_0", "fighter_1"),
        default_victim="zoo:sumo-humans/fighter/v3",
        fallback_victim="embedded:sumo-humans/fighter/v3",
        baseline_adversary="zoo:sumo-humans/fighter/v1",
        config="apil_envs.options:SumoOptions",
        matchups=(
            Matchup("zoo:sumo-humans/fighter/v1", "zoo:sumo-humans/fighter/v3", _published(7, 7)),
            # the published code gives both sides the same version: docs/fidelity.md
            Matchup("zoo:sumo-humans/fighter/v1", "zoo:sumo-humans/fighter/v1", _published(7, 7)),
        ),
    ),
    GameSpec(
        name="sumo-ants",
        factory="apil_envs.sumo:SumoAnts",
        interchangeable_sides=True,
        summary="two ants push each other off a round platform",
        sides=("fighter_0", "fighter_1"),
        default_victim="zoo:sumo-ants/fighter/v1",
        fallback_victim="embedded:sumo-ants/fighter/v1",
        baseline_adversary="zoo:sumo-ants/fighter/v2",
        rewards=RewardWeights(dense_weight=1.0, anneal_fraction=0.1),
        config="apil_envs.options:SumoOptions",
        matchups=(
            Matchup("zoo:sumo-ants/fighter/v2", "zoo:sumo-ants/fighter/v1", _published(39, 56)),
            Matchup(
                "zoo:sumo-ants/fighter/v1",
                "zoo:sumo-ants/fighter/v1",
                _published(39, 56),
                stands_in_for="zoo:sumo-ants/fighter/v2",
            ),
        ),
    ),
    GameSpec(
        name="run-to-goal-humans",
        factory="apil_envs.run_to_goal:RunToGoalHumans",
        summary="two humanoids each run for the line behind the other",
        sides=("runner_0", "runner_1"),
        default_victim="zoo:run-to-goal-humans/runner_0/v1",
        baseline_adversary="zoo:run-to-goal-humans/runner_1/v1",
        config="apil_envs.options:RunToGoalHumansOptions",
        matchups=(Matchup("zoo:run-to-goal-humans/runner_1/v1", "zoo:run-to-goal-humans/runner_0/v1"),),
    ),
    GameSpec(
        name="run-to-goal-ants",
        factory="apil_envs.run_to_goal:RunToGoalAnts",
        summary="two ants each run for the line behind the other",
        sides=("runner_0", "runner_1"),
        default_victim="zoo:run-to-goal-ants/runner_0/v1",
        baseline_adversary="zoo:run-to-goal-ants/runner_1/v1",
        config="apil_envs.options:RunToGoalAntsOptions",
        matchups=(Matchup("zoo:run-to-goal-ants/runner_1/v1", "zoo:run-to-goal-ants/runner_0/v1"),),
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
def register_games() -> list[GameSpec]:
    """The six games of Bansal et al. 2018, and a toy game for quick trials and tests."""
    return _GAMES


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
