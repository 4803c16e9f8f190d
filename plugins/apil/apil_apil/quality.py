"""How well the imitator predicts, and how well D tells (docs/methods.md §4)."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core import DiagonalGaussian


def prediction_quality(prediction: DiagonalGaussian, action: Tensor) -> dict[str, float]:
    """Log-likelihood (nats per step) and mean squared error of predicting ``action`` (T, n, a).

    Measured on games the imitator has not learnt from. ``constant_*`` are the same for the best
    constant Gaussian fitted to these very actions, which sees the answers: a high bar.
    """
    flat = action.flatten(0, -2)
    constant = DiagonalGaussian(flat.mean(0), flat.std(0).clamp_min(1e-6))
    return {
        "log_likelihood": float(prediction.log_prob(action).mean()),
        "mse": float((prediction.mean - action).square().mean()),
        "constant_log_likelihood": float(constant.log_prob(flat).mean()),
        "constant_mse": float((constant.mean - flat).square().mean()),
        "imitator_std": float(prediction.std.mean()),
    }


def accuracy(victim_logits: Tensor, imitator_logits: Tensor) -> dict[str, float]:
    """Share of each class that D tells right (before its update), from its logits."""
    return {
        "discriminator_accuracy_victim": float((victim_logits > 0).to(torch.float32).mean()),
        "discriminator_accuracy_imitator": float((imitator_logits < 0).to(torch.float32).mean()),
    }
