"""``torchscript:FILE``: a network saved with ``torch.jit``.

A TorchScript archive runs in torch's own interpreter, which executes tensor operators and no Python. A few
of them access files, and may run while the archive is loaded: code that names one is refused.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from apil_core.api.game import SideLayout
from apil_core.api.policy import Policy
from apil_core.common.errors import reason_of
from apil_core.policies.foreign.archive import read_archive, rebuilt
from apil_core.policies.foreign.network import SIGNATURE_FILE, NetworkPolicy, Signature
from apil_core.policies.foreign.origin import Origin
from apil_core.policies.foreign.state_inside import state_outside

KIND = "a TorchScript archive (torch.jit.save)"

_REACHES_OUT = re.compile(
    rb"\b(?:save|from_file|load_tensor)\b|\bops\s*\.\s*(?!aten\b|prim\b)\w+|\btorch\s*\.\s*classes\b"
)
"""torch.save, torch.from_file, debugprims.load_tensor; operators and classes of other libraries."""
_PICKLES = ("data.pkl", "constants.pkl")


def load(name: str, *, seat: SideLayout | None) -> Policy:
    """The network in that file; see :mod:`apil_core.policies.foreign.network` for what it takes and gives.

    Raises:
        VictimError: there is no such file, it is no TorchScript archive, its code accesses files, or it
            keeps state between calls that cannot be kept for each game.
    """
    origin = Origin.of("torchscript", name)
    content = read_archive(origin, KIND)
    _check(origin, content)
    signature = Signature.read(content.get(f"extra/{SIGNATURE_FILE}"), origin.name)
    network = _open(origin, content)

    def call(inputs: list[Tensor]) -> Any:
        try:
            return network(*inputs)
        except RuntimeError as error:  # the interpreter's traceback comes first, the reason last
            raise RuntimeError(str(error).strip().splitlines()[-1].removeprefix("RuntimeError: ")) from error

    outside, signature = state_outside(origin, network, call, signature, seat)
    return NetworkPolicy(origin, outside, signature, seat, move=network.to, alone=outside)


def _check(origin: Origin, content: Mapping[str, bytes]) -> None:
    if "data.pkl" not in content or not any(name.startswith("code/") for name in content):
        raise origin.wrong(KIND, "an archive without TorchScript code")
    for name, data in content.items():
        if name.endswith(".py"):
            reach = _REACHES_OUT.search(data)
            if reach is not None:
                raise origin.wrong("operators on tensors only", f"{reach.group().decode()!r} in {name}")
        if name in _PICKLES and b"torch.classes" in data:
            raise origin.wrong("tensors and modules only", f"an object of another library in {name}")


def _open(origin: Origin, content: Mapping[str, bytes]) -> Any:
    wanted = {
        name: data
        for name, data in content.items()
        if name.startswith(("code/", "data/", "constants/")) or name in _PICKLES
    }
    try:
        archive = rebuilt(wanted, int(content.get("version", b"0")))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # torch recommends torch.export
            return torch.jit.load(archive, map_location="cpu").eval()
    except Exception as error:
        raise origin.wrong(KIND, reason_of(error)) from error
