"""Check of a tensor for NaN and infinities, in one pass: it runs several times a step."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def all_finite(values: Tensor) -> bool:
    """True if no entry is NaN or infinite."""
    # a sum propagates every NaN and infinity; entries are checked only if the sum is not finite
    return math.isfinite(float(values.sum())) or bool(torch.isfinite(values).all())
