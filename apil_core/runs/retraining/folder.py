"""The directory of a retraining: a run directory with the hardened victim."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from apil_core.api.config import RunConfig
from apil_core.common.errors import RunDirError, VictimError
from apil_core.common.files import write_atomically
from apil_core.config.absent import read_stored
from apil_core.config.kind import is_retraining
from apil_core.config.layers import file_layer
from apil_core.config.problems import problems_of, raise_problems
from apil_core.config.yaml import commented_yaml
from apil_core.plugins.discovery import PluginRegistry
from apil_core.plugins.registry import default_plugins
from apil_core.policies.frozen_policy import FrozenPolicy
from apil_core.runs.retraining.config import NOT_ITS_OWN, RetrainConfig
from apil_core.training.storage.run_dir import RunDir

SCHEME = "retrained"


class RetrainDir(RunDir):
    """Paths and files of one retraining.

    Args:
        path: its directory; it need not exist yet.
    """

    def __init__(self, path: Path | str):
        super().__init__(path)
        self.victim_path = self.path / "victim.safetensors"

    @staticmethod
    def _folder(config: RunConfig) -> str:
        assert isinstance(config, RetrainConfig)
        return f"retrain/{'+'.join(config.labels)}"

    def write_config(self, config: RunConfig, plugins: PluginRegistry) -> None:
        """Store the settings."""
        own = config.model_dump(mode="json", exclude={name for name in NOT_ITS_OWN if "." not in name})
        text = commented_yaml(own, RetrainConfig).encode()
        write_atomically(self.config_path, lambda file: file.write(text))

    def config(self) -> RetrainConfig:
        """Read the stored settings.

        Raises:
            RunDirError: this is no retraining's directory.
            ConfigError: the settings are damaged.
        """
        if not is_retraining(self.path):
            raise RunDirError(f"{self.path} is no retraining's directory (no config.yaml of one in it)")
        layer = file_layer(self.config_path)
        try:
            return read_stored(layer.data, default_plugins(), RetrainConfig)
        except ValidationError as error:
            raise_problems(problems_of(error, RetrainConfig), layer.origins)
            raise


def name_of(path: Path) -> str:
    """Full name of the hardened victim in that directory."""
    return f"{SCHEME}:{path.expanduser().absolute()}"


def load(name: str) -> FrozenPolicy:
    """Load a new policy on the CPU; the file format is a student's (:mod:`apil_core.policies.student`).

    Args:
        name: directory of the retraining.

    Raises:
        VictimError: there is no retraining, it has no victim yet, or the file is damaged.
    """
    from apil_core.policies.student import load_file

    path = Path(name).expanduser()
    directory = RetrainDir(path)
    if not directory.victim_path.is_file():
        why = "has no victim yet: it comes with the first checkpoint" if is_retraining(path) else "is none"
        raise VictimError(f"{SCHEME}:{name}: {SCHEME}:DIR is the directory of a retraining, and {path} {why}")
    return load_file(directory.victim_path, name_of(path))
