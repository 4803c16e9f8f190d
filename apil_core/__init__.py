"""APIL: adversarial-policy attacks on deep-RL agents in two-player games.

Everything in ``__all__`` is the public API; plugins and games import from here only. Names load
lazily (PEP 562), so importing this package brings in neither torch nor mujoco.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "apil_core.api.hooks": ("hookimpl", "hookspec"),
    "apil_core.api.hook_api": ("HOOK_API", "Deprecation"),
    "apil_core.common.errors": (
        "ApilError",
        "ConfigError",
        "PluginError",
        "RunDirError",
        "UnknownNameError",
        "VictimError",
    ),
    "apil_core.api.specs": (
        "GameSpec",
        "Matchup",
        "MethodSpec",
        "ObserverSpec",
        "PolicyListing",
        "PolicySpec",
        "PublishedScore",
        "RecorderSpec",
        "RewardWeights",
    ),
    "apil_core.common.colours": ("Colour",),
    "apil_core.api.game": (
        "NO_WINNER",
        "Game",
        "GameLayout",
        "GameStep",
        "PhysicsStopwatch",
        "SideLayout",
        "Window",
    ),
    "apil_core.games.vector": ("GameVectorEnv", "sb3_vec_env"),
    "apil_core.games.views": ("OpponentInsideEnv", "ParallelGameEnv"),
    "apil_core.common.trust": ("trust",),
    "apil_core.common.torch_threads": ("side_by_side",),
    "apil_core.api.types": ("Context", "Decision", "DiagonalGaussian", "Rollout", "StepBatch", "View"),
    "apil_core.api.policy": ("Policy", "PolicyInfo"),
    "apil_core.api.method": ("Callback", "Method", "MethodSetup", "Observer", "Run", "RunPlugin"),
    "apil_core.training.networks": ("GaussianActor", "mlp"),
    "apil_core.training.normalize": ("ObservationNormalizer", "ReturnNormalizer", "RunningMoments"),
    "apil_core.training.returns": ("gae", "normalize_advantages"),
    "apil_core.api.config": (
        "CheckpointConfig",
        "EvaluationConfig",
        "PPOConfig",
        "RewardConfig",
        "RunConfig",
        "Section",
        "absent",
    ),
    "apil_core.api.profiles": ("ProfiledOptions",),
    "apil_core.evaluation.results": ("EvaluationResult",),
    "apil_core.evaluation.score": ("evaluate",),
    "apil_core.config.resolve": ("_load_config",),
    "apil_core.plugins.defined": ("define",),
    "apil_core.runs.runner": ("RunResult", "resume", "run"),
    "apil_core.evaluation.crossplay.crossplay": ("crossplay",),
    "apil_core.runs.retraining.retrain": ("retrain", "resume_retraining"),
    "apil_core.runs.distillation.distill": ("distill",),
    "apil_core.training.export.export": ("export",),
    "apil_core.studies.seeds": ("run_seeds",),
    "apil_core.studies.tune.tune": ("TuneResult", "tune"),
    "apil_core.studies.loaded_run": ("LoadedRun", "Media", "load_run", "plot_runs"),
    "apil_core.plugins.registry": ("load_policy", "make_game"),
    "apil_core.policies.conformance": ("Conformance", "check_policy"),
    "apil_core.policies.network": ("NetworkShape", "PolicyNetwork"),
    "apil_core.policies.frozen_policy": ("FrozenPolicy",),
    "apil_core.policies.student": ("save_policy",),
    "apil_core.policies.foreign.pickles": ("Opaque", "read_pickle"),
    "apil_core.games.pettingzoo.options": ("PettingZooOptions",),
    "apil_core.games.pettingzoo.plugin": ("pettingzoo_spec",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted([*(name for name in _HOME_OF if name[0] != "_"), "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'apil_core' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)


if TYPE_CHECKING:
    from apil_core.api.config import CheckpointConfig as CheckpointConfig
    from apil_core.api.config import EvaluationConfig as EvaluationConfig
    from apil_core.api.config import PPOConfig as PPOConfig
    from apil_core.api.config import RewardConfig as RewardConfig
    from apil_core.api.config import RunConfig as RunConfig
    from apil_core.api.config import Section as Section
    from apil_core.api.config import absent as absent
    from apil_core.api.game import NO_WINNER as NO_WINNER
    from apil_core.api.game import Game as Game
    from apil_core.api.game import GameLayout as GameLayout
    from apil_core.api.game import GameStep as GameStep
    from apil_core.api.game import PhysicsStopwatch as PhysicsStopwatch
    from apil_core.api.game import SideLayout as SideLayout
    from apil_core.api.game import Window as Window
    from apil_core.api.hook_api import HOOK_API as HOOK_API
    from apil_core.api.hook_api import Deprecation as Deprecation
    from apil_core.api.hooks import hookimpl as hookimpl
    from apil_core.api.hooks import hookspec as hookspec
    from apil_core.api.method import Callback as Callback
    from apil_core.api.method import Method as Method
    from apil_core.api.method import MethodSetup as MethodSetup
    from apil_core.api.method import Observer as Observer
    from apil_core.api.method import Run as Run
    from apil_core.api.method import RunPlugin as RunPlugin
    from apil_core.api.policy import Policy as Policy
    from apil_core.api.policy import PolicyInfo as PolicyInfo
    from apil_core.api.profiles import ProfiledOptions as ProfiledOptions
    from apil_core.api.specs import GameSpec as GameSpec
    from apil_core.api.specs import Matchup as Matchup
    from apil_core.api.specs import MethodSpec as MethodSpec
    from apil_core.api.specs import ObserverSpec as ObserverSpec
    from apil_core.api.specs import PolicyListing as PolicyListing
    from apil_core.api.specs import PolicySpec as PolicySpec
    from apil_core.api.specs import PublishedScore as PublishedScore
    from apil_core.api.specs import RecorderSpec as RecorderSpec
    from apil_core.api.specs import RewardWeights as RewardWeights
    from apil_core.api.types import Context as Context
    from apil_core.api.types import Decision as Decision
    from apil_core.api.types import DiagonalGaussian as DiagonalGaussian
    from apil_core.api.types import Rollout as Rollout
    from apil_core.api.types import StepBatch as StepBatch
    from apil_core.api.types import View as View
    from apil_core.common.colours import Colour as Colour
    from apil_core.common.errors import ApilError as ApilError
    from apil_core.common.errors import ConfigError as ConfigError
    from apil_core.common.errors import PluginError as PluginError
    from apil_core.common.errors import RunDirError as RunDirError
    from apil_core.common.errors import UnknownNameError as UnknownNameError
    from apil_core.common.errors import VictimError as VictimError
    from apil_core.common.torch_threads import side_by_side as side_by_side
    from apil_core.common.trust import trust as trust
    from apil_core.config.resolve import _load_config as _load_config
    from apil_core.evaluation.crossplay.crossplay import crossplay as crossplay
    from apil_core.evaluation.results import EvaluationResult as EvaluationResult
    from apil_core.evaluation.score import evaluate as evaluate
    from apil_core.games.pettingzoo.options import PettingZooOptions as PettingZooOptions
    from apil_core.games.pettingzoo.plugin import pettingzoo_spec as pettingzoo_spec
    from apil_core.games.vector import GameVectorEnv as GameVectorEnv
    from apil_core.games.vector import sb3_vec_env as sb3_vec_env
    from apil_core.games.views import OpponentInsideEnv as OpponentInsideEnv
    from apil_core.games.views import ParallelGameEnv as ParallelGameEnv
    from apil_core.plugins.defined import define as define
    from apil_core.plugins.registry import load_policy as load_policy
    from apil_core.plugins.registry import make_game as make_game
    from apil_core.policies.conformance import Conformance as Conformance
    from apil_core.policies.conformance import check_policy as check_policy
    from apil_core.policies.foreign.pickles import Opaque as Opaque
    from apil_core.policies.foreign.pickles import read_pickle as read_pickle
    from apil_core.policies.frozen_policy import FrozenPolicy as FrozenPolicy
    from apil_core.policies.network import NetworkShape as NetworkShape
    from apil_core.policies.network import PolicyNetwork as PolicyNetwork
    from apil_core.policies.student import save_policy as save_policy
    from apil_core.runs.distillation.distill import distill as distill
    from apil_core.runs.retraining.retrain import resume_retraining as resume_retraining
    from apil_core.runs.retraining.retrain import retrain as retrain
    from apil_core.runs.runner import RunResult as RunResult
    from apil_core.runs.runner import resume as resume
    from apil_core.runs.runner import run as run
    from apil_core.studies.loaded_run import LoadedRun as LoadedRun
    from apil_core.studies.loaded_run import Media as Media
    from apil_core.studies.loaded_run import load_run as load_run
    from apil_core.studies.loaded_run import plot_runs as plot_runs
    from apil_core.studies.seeds import run_seeds as run_seeds
    from apil_core.studies.tune.tune import TuneResult as TuneResult
    from apil_core.studies.tune.tune import tune as tune
    from apil_core.training.export.export import export as export
    from apil_core.training.networks import GaussianActor as GaussianActor
    from apil_core.training.networks import mlp as mlp
    from apil_core.training.normalize import ObservationNormalizer as ObservationNormalizer
    from apil_core.training.normalize import ReturnNormalizer as ReturnNormalizer
    from apil_core.training.normalize import RunningMoments as RunningMoments
    from apil_core.training.returns import gae as gae
    from apil_core.training.returns import normalize_advantages as normalize_advantages
