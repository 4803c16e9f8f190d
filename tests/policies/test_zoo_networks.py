"""The torch networks against plain numpy, computed from the flat vector by counting offsets."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from apil_core import View
from apil_core.policies import zoo as store
from apil_core.policies import zoo_catalogue as catalogue
from apil_core.policies.network import PolicyNetwork
from apil_core.policies.zoo_layout import vector_length
from apil_core.policies.zoo_policy import ZooPolicy

Array = NDArray[Any]
LSTM, MLP = "kick-and-defend/kicker/v1", "you-shall-not-pass/blocker/v1"


class Tape:
    """Hands out consecutive pieces of the vector, in float64."""

    def __init__(self, vector: Array):
        self.rest = vector.astype(np.float64)

    def take(self, *shape: int) -> Array:
        count = int(np.prod(shape))
        piece, self.rest = self.rest[:count], self.rest[count:]
        return piece.reshape(shape)


def sigmoid(x: Array) -> Array:
    return 1 / (1 + np.exp(-x))


def moments(tape: Tape, *shape: int) -> tuple[Array, Array]:
    total, squares, count = tape.take(*shape), tape.take(*shape), tape.take(1)
    mean = total / count
    return mean, np.sqrt(np.maximum(squares / count - mean**2, 0.01))


def mlp_games(tape: Tape, z: Array, outputs: int) -> tuple[Array, Array]:
    size = z.shape[-1]
    hidden = np.tanh(z @ tape.take(size, 64) + tape.take(64))
    hidden = np.tanh(hidden @ tape.take(64, 64) + tape.take(64))
    return hidden @ tape.take(64, outputs) + tape.take(outputs), hidden


def lstm_games(tape: Tape, z: Array, first: Array, outputs: int) -> tuple[Array, Array]:
    """Every game and step on its own; ``z`` is (T, n, o), ``first`` (T, n)."""
    size = z.shape[-1]
    embed, embed_bias = tape.take(size, 128), tape.take(128)
    kernel, bias = tape.take(256, 512), tape.take(512)
    out, out_bias = tape.take(128, outputs), tape.take(outputs)
    hidden = np.zeros((*first.shape, 128))
    for game in range(first.shape[1]):
        for step in range(len(first)):
            if first[step, game]:
                h, c = np.zeros(128), np.zeros(128)
            x = np.maximum(z[step, game] @ embed + embed_bias, 0)
            i, j, f, o = np.split(np.concatenate([x, h]) @ kernel + bias, 4)
            c = sigmoid(f + 1.0) * c + sigmoid(i) * np.tanh(j)
            h = sigmoid(o) * np.tanh(c)
            hidden[step, game] = h
    return hidden @ out + out_bias, hidden


def reference(vector: Array, name: str, observations: Array, first: Array) -> dict[str, Array]:
    """``mean`` (T, n, a), ``hidden`` (T, n, k), ``value`` (T, n) and ``std`` (a,)."""
    facts = catalogue.entries()[name].facts
    tape = Tape(vector)
    return_mean, return_std = moments(tape, 1)
    mean, std = moments(tape, facts.observation_size)
    z = np.clip((observations - mean) / std, -5, 5)
    if facts.recurrent:
        value, _ = lstm_games(tape, z, first, 1)
        action, hidden = lstm_games(tape, z, first, facts.action_size)
    else:
        value, _ = mlp_games(tape, z, 1)
        action, hidden = mlp_games(tape, z, facts.action_size)
    logstd = tape.take(facts.action_size)
    assert tape.rest.size == 0
    value = value[..., 0] * return_std + return_mean
    return {"mean": action, "hidden": hidden, "value": value, "std": np.exp(logstd)}


def some_games(name: str, steps: int = 6, games: int = 4) -> tuple[Array, Array]:
    rng = np.random.default_rng(5)
    size = catalogue.entries()[name].facts.observation_size
    observations = rng.normal(0, 3, (steps, games, size)).astype(np.float32)
    first = np.zeros((steps, games), bool)
    first[0] = True
    first[2, 1] = first[4, :2] = True
    return observations, first


def view(observation: Array, first: Array) -> View:
    own = torch.from_numpy(observation)
    return View(own=own, opponent=own, first=torch.from_numpy(first))


def check_against_reference(policy: ZooPolicy, vector: Array, name: str) -> None:
    observations, first = some_games(name)
    expected = reference(vector, name, observations, first)
    for step in range(len(first)):
        now = view(observations[step], first[step])
        decision = policy.act(now, sample=False, activations=True)
        assert decision.distribution is not None
        assert decision.activations is not None
        got = {"mean": decision.distribution.mean, "hidden": decision.activations["hidden"]}
        for key, tensor in got.items():
            np.testing.assert_allclose(tensor, expected[key][step], rtol=2e-4, atol=2e-5, err_msg=key)
            assert tensor.dtype == torch.float32
        np.testing.assert_array_equal(decision.action, got["mean"])
        np.testing.assert_allclose(decision.distribution.std, expected["std"], rtol=1e-6)
    assert policy.critic is not None
    critic = PolicyNetwork.of(policy.critic.shape, policy.critic.weights)
    z = policy.standardize(torch.from_numpy(observations))
    done = torch.from_numpy(np.roll(first, -1, axis=0))
    with torch.no_grad():
        value, _ = critic(z, done, critic.zero_state(first.shape[1]))
    returns = value[..., 0] * policy.critic.deviation + policy.critic.mean
    np.testing.assert_allclose(returns, expected["value"], rtol=2e-4, atol=2e-5)


@pytest.fixture
def lstm(made_up_zoo: Path) -> ZooPolicy:
    store.import_zoo(made_up_zoo)
    return store.load(LSTM)


@pytest.mark.parametrize(
    ("game", "length"),
    [
        ("kick-and-defend", 364_839),
        ("you-shall-not-pass", 59_039),
        ("sumo-humans", 367_677),
        ("sumo-ants", 299_943),
        ("run-to-goal-humans", 59_039),
        ("run-to-goal-ants", 24_905),
    ],
)
def test_vector_lengths(game: str, length: int) -> None:
    assert vector_length(catalogue.GAMES[game]) == length


def test_made_up_agents_equal_numpy(made_up_zoo: Path, vectors: dict[str, Array]) -> None:
    store.import_zoo(made_up_zoo)
    for name, vector in vectors.items():
        check_against_reference(store.load(name), vector, name)


def test_real_agents_equal_numpy(zoo_dir: Path) -> None:
    rows = store.import_zoo(zoo_dir)
    assert rows
    for row in rows:
        name = row.name.removeprefix("zoo:")
        vector = pickle.loads(Path(row.source).read_bytes())  # its sum has just been checked
        check_against_reference(store.load(name), vector, name)


def test_sampling_uses_the_generator_only(lstm: ZooPolicy) -> None:
    observations, first = some_games(LSTM)
    now = view(observations[0], first[0])
    draws = []
    for _ in range(2):
        torch.manual_seed(len(draws))
        generator = torch.Generator().manual_seed(3)
        draws.append(lstm.act(now, sample=True, generator=generator))
    assert torch.equal(draws[0].action, draws[1].action)
    distribution = draws[0].distribution
    assert distribution is not None
    noise = torch.randn(draws[0].action.shape, generator=torch.Generator().manual_seed(3))
    assert torch.equal(draws[0].action, distribution.mean + distribution.std * noise)


def test_recurrent_state_round_trip(lstm: ZooPolicy) -> None:
    observations, first = some_games(LSTM)
    first[1:] = False
    lstm.act(view(observations[0], first[0]), sample=False)
    state = lstm.recurrent_state()
    assert {key: rows.shape for key, rows in state.items()} == dict.fromkeys(("actor.h", "actor.c"), (4, 128))
    kept = {key: rows.clone() for key, rows in state.items()}
    expected = [
        lstm.act(view(o, f), sample=False).action for o, f in zip(observations[1:], first[1:], strict=True)
    ]
    assert all(torch.equal(state[key], kept[key]) for key in state)  # stepping on leaves it as it was
    other = store.load(LSTM)
    other.load_recurrent_state(state)
    for key in state:
        state[key].zero_()  # nor does the policy keep a hold on what it was given
    for step, action in enumerate(expected, start=1):
        assert torch.equal(other.act(view(observations[step], first[step]), sample=False).action, action)


def test_feed_forward_has_no_state(made_up_zoo: Path) -> None:
    store.import_zoo(made_up_zoo)
    policy = store.load(MLP)
    observations, first = some_games(MLP)
    policy.act(view(observations[0], first[0]), sample=False)
    assert policy.recurrent_state() == {}


def test_number_of_games_changes_with_new_games_only(lstm: ZooPolicy) -> None:
    observations, first = some_games(LSTM)
    middle = np.array([True, False, True, True])
    with pytest.raises(ValueError, match="not all of them are new"):
        lstm.act(view(observations[0], middle), sample=False)
    lstm.act(view(observations[0], first[0]), sample=False)
    with pytest.raises(ValueError, match="2 games after 4"):
        lstm.act(view(observations[1, :2], np.array([True, False])), sample=False)
    assert lstm.act(view(observations[1, :2], np.array([True, True])), sample=False).action.shape == (2, 17)


def test_wrong_observation_size(lstm: ZooPolicy) -> None:
    with pytest.raises(ValueError, match="reads 384 observations, got 380"):
        lstm.act(view(np.zeros((2, 380), np.float32), np.ones(2, bool)), sample=False)


def test_actions_may_enter_a_loss(lstm: ZooPolicy) -> None:
    observations, first = some_games(LSTM)
    action = lstm.act(view(observations[0], first[0]), sample=False).action
    assert not action.requires_grad
    layer = torch.nn.Linear(17, 1)
    layer(action).sum().backward()
    assert layer.weight.grad is not None


def test_to_moves_everything(lstm: ZooPolicy) -> None:
    observations, first = some_games(LSTM)
    lstm.act(view(observations[0], first[0]), sample=False)
    assert lstm.to("meta") is lstm
    assert {rows.device.type for rows in lstm.recurrent_state().values()} == {"meta"}
    assert lstm.standardize(torch.zeros(1, 384, device="meta")).device.type == "meta"
