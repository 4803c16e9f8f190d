"""Runs of several processes, for tests: a command line for torchrun, and what it starts.

``torchrun … together.py DIR NAME…`` resumes the run DIR/NAME if there is one, else trains DIR/NAME.yaml.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from apil_core import RunConfig, resume, run, trust
from apil_core.config.layers import file_layer
from apil_core.training.distributed.join import joined


def torchrun(*arguments: str | Path, module: bool = False) -> subprocess.Popen[str]:
    """Start two processes with a script, or a module, and its arguments."""
    command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", "--standalone"]
    return subprocess.Popen(
        [*command, *(["-m"] if module else []), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "COLUMNS": "200"},
    )


def train(folder: Path, *names: str) -> str:
    """Run or resume, one after the other; returns what was printed."""
    process = torchrun(__file__, folder, *names)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0, output
    return output


def main(folder: Path, names: list[str]) -> None:
    trust("--trust")  # plugins that the configurations name
    with joined("cpu"):
        for name in names:
            if (folder / name / "config.yaml").is_file():
                resume(folder / name)
            else:
                config = RunConfig.model_validate(file_layer(folder / f"{name}.yaml").data)
                run(config, out=folder / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
