"""The loop over an episode, with an environment that counts."""

import pytest

from wt_gym.envs.episode import episode_steps


class Counter:
    """Observes the number of steps; ends after three, as told."""

    def __init__(self, terminated, info):
        self.actions, self._last = [], (terminated, not terminated, info)

    def step(self, action):
        self.actions.append(action)
        return len(self.actions), 0.5, *((False, False, {}) if len(self.actions) < 3 else self._last)


class Note:
    """Acts by the observation, keeps what it was asked in its state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return 10 * observation, [*(state or []), (observation, episode_start.tolist(), deterministic)]


@pytest.mark.parametrize("terminated", [True, False])
def test_every_step_sees_the_one_before(terminated):
    env, seen = Counter(terminated, {"failure": "diverged"}), []

    class Spy(Note):
        def predict(self, *args, **kwargs):
            action, state = super().predict(*args, **kwargs)
            seen[:] = state
            return action, state

    steps = episode_steps(env, Spy(), 0)
    assert env.actions == []  # made as they are asked for
    steps = list(steps)
    assert [step.action for step in steps] == env.actions == [0, 10, 20]
    assert [step.observation for step in steps] == [1, 2, 3]
    assert seen == [(0, [True], True), (1, [False], True), (2, [False], True)]
    assert [(step.done, step.failed) for step in steps] == [(False, False), (False, False), (True, True)]
    assert steps[-1].terminated == terminated
