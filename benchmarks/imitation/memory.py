"""Compare an LSTM and an MLP imitator, trained by maximum likelihood on the same recorded games.

    python benchmarks/imitation/memory.py RECORDING

Each rollout is met once: measured first, then learnt from in as many passes by both. The LSTM's state is
carried from rollout to rollout and is reset at every start of a game.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
from study import recorded
from torch import Tensor, nn

from apil_apil.quality import prediction_quality
from apil_core import DiagonalGaussian, ObservationNormalizer, mlp
from apil_core.common.torch_threads import one_torch_thread

PASSES, PARTS, RATE = 4, 4, 1e-3
State = tuple[Tensor, Tensor]
FORMATTER = argparse.RawDescriptionHelpFormatter


class Predictor(nn.Module):
    """A Gaussian with a mean from a tanh network of 64-64, behind an LSTM cell of 128 units if ``memory``."""

    def __init__(self, size: int, actions: int, *, memory: bool):
        super().__init__()
        self.cell = nn.LSTMCell(size, 128) if memory else None
        # a skip connection, so that the model with memory contains the one without
        self.body = mlp((size + 128 * memory, 64, 64, actions), output_gain=0.01)
        self.log_std = nn.Parameter(torch.zeros(actions))
        self.optimizer = torch.optim.Adam(self.parameters(), RATE, eps=1e-5)

    def forward(self, states: Tensor, done: Tensor, start: State) -> tuple[DiagonalGaussian, State]:
        """Distributions for (T, n, s), and the cell's state after the last step."""
        if self.cell is None:
            return DiagonalGaussian(self.body(states), self.log_std.exp()), start
        h, c = start
        outputs = []
        for row, ended in zip(states.unbind(0), done.unbind(0), strict=True):
            h, c = self.cell(row, (h, c))
            outputs.append(h)
            going_on = (~ended).unsqueeze(-1)
            h, c = h * going_on, c * going_on
        mean = self.body(torch.cat([states, torch.stack(outputs)], dim=-1))
        return DiagonalGaussian(mean, self.log_std.exp()), (h, c)


def measure_and_learn(
    predictor: Predictor, data: dict[str, Tensor], states: Tensor, start: State, generator: torch.Generator
) -> tuple[dict[str, float], State]:
    done, actions = data["done"], data["victim_action"]
    with torch.no_grad():
        prediction, end = predictor(states, done, start)
    quality = prediction_quality(prediction, recorded(data))
    for _ in range(PASSES):
        for games in torch.randperm(done.shape[1], generator=generator).chunk(PARTS):
            part, _ = predictor(states[:, games], done[:, games], (start[0][games], start[1][games]))
            loss = -part.log_prob(actions[:, games]).mean()
            predictor.optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(predictor.parameters(), 0.5)
            predictor.optimizer.step()
    return quality, end


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=FORMATTER)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="JSON file for all metrics")
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    generator = torch.Generator().manual_seed(arguments.seed)
    files = sorted(arguments.recording.glob("*.pt"))
    first = torch.load(files[0], weights_only=True)
    games, size = first["victim_observation"].shape[1:]
    normalizer = ObservationNormalizer(size)
    normalizer.update(first["victim_observation"].flatten(0, 1))
    named = {
        name: Predictor(size, first["victim_action"].shape[-1], memory=memory)
        for name, memory in (("MLP", False), ("LSTM", True))
    }
    zero = torch.zeros(games, 128)
    states = dict.fromkeys(named, (zero, zero))
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in named}
    with one_torch_thread():
        for file in files:
            data = torch.load(file, weights_only=True)
            normal = normalizer(data["victim_observation"])
            for name, predictor in named.items():
                quality, states[name] = measure_and_learn(predictor, data, normal, states[name], generator)
                rows[name].append(quality)
            normalizer.update(data["victim_observation"].flatten(0, 1))
            newest = {name: found[-1] for name, found in rows.items()}
            shown = [
                f"{name} {q['explained_share']:.3f} {q['log_likelihood']:.2f}" for name, q in newest.items()
            ]
            print(f"{file.stem}: explained share, log-likelihood: {', '.join(shown)}", flush=True)
    for name, found in rows.items():
        last = {key: sum(row[key] for row in found[-5:]) / 5 for key in found[-1]}
        print(f"{name}, mean of the last five: {json.dumps(last)}")
    if arguments.out:
        kept = {
            name: [{k: round(v, 4) for k, v in row.items()} for row in found] for name, found in rows.items()
        }
        arguments.out.write_text(json.dumps(kept) + "\n")


if __name__ == "__main__":
    main()
