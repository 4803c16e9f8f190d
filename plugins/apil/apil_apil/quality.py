"""Metrics of the imitator's predictions and of D (docs/methods.md §4)."""

from __future__ import annotations

import torch
from torch import Tensor

from apil_core import DiagonalGaussian, Rollout


def prediction_quality(prediction: DiagonalGaussian, rollout: Rollout) -> dict[str, float]:
    """Errors of ``prediction`` (T, n, a) of the victim's actions, on games not yet used for training.

    ``constant_*`` are of the best constant Gaussian, fitted to these same actions: a strong baseline.
    ``relative_error`` is ``mse`` over the constant's. ``explained_share`` is the explained share of the
    explainable: (MSE_constant − MSE) / (MSE_constant − MSE_victim), MSE_victim that of the victim's own mean,
    its noise; absent where the victim does not give its mean (a black box), or is constant but for noise.

    Returns:
        log-likelihoods in nats per step, mean squared errors per action component, and the two shares.
    """
    action = rollout.victim_action
    flat = action.flatten(0, -2)
    constant = DiagonalGaussian(flat.mean(0), flat.std(0).clamp_min(1e-6))
    error = float((prediction.mean - action).square().mean())
    bar = float((constant.mean - flat).square().mean())
    metrics = {
        "log_likelihood": float(prediction.log_prob(action).mean()),
        "constant_log_likelihood": float(constant.log_prob(flat).mean()),
        "mse": error,
        "constant_mse": bar,
        "imitator_std": float(prediction.std.mean()),
    }
    if bar > 0:
        metrics["relative_error"] = error / bar
    if rollout.victim_mean is not None:
        noise = float((rollout.victim_mean - action).square().mean())
        if bar > noise:
            metrics["explained_share"] = (bar - error) / (bar - noise)
    return metrics


def accuracy(victim_logits: Tensor, imitator_logits: Tensor) -> dict[str, float]:
    """Accuracy of D per class (before its update), from its logits."""
    return {
        "discriminator_accuracy_victim": float((victim_logits > 0).to(torch.float32).mean()),
        "discriminator_accuracy_imitator": float((imitator_logits < 0).to(torch.float32).mean()),
    }
