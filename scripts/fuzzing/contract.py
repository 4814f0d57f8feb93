"""The contract of the environment, checked from outside in each step."""

import copy
import math
from typing import Any, NamedTuple, cast

import numpy as np
from gymnasium.error import ResetNeeded

from fuzzing.energy import EnergyAccount
from wt_gym.base.errors import ActionError
from wt_gym.envs.terminations import COST_NAMES
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.simulation import Simulator

_ENDINGS = ("overspeed", "standstill", "tower_strike", "failure")
_INFO = {
    "time", "wind_speed", "wind_seed", "generator_power", "rotor_speed", "rotor_speed_max", "tip_clearance_min",
    "saturated", "idle_time",
}  # fmt: skip
_ROUNDING = 1e-9


class ContractBroken(Exception):
    """The environment did something that its documentation excludes."""


class StepResult(NamedTuple):
    """What `WindTurbineEnv.step` returns."""

    observation: np.ndarray
    reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


def require(holds: bool, message: str) -> None:
    """Raise `ContractBroken` unless something holds."""
    if not holds:
        raise ContractBroken(message)


class Contract:
    """An environment whose every answer is looked at.

    Parameters
    ----------
    env : WindTurbineEnv
        Without wrappers, with a scalar reward.
    """

    def __init__(self, env: WindTurbineEnv):
        self.env = env
        weights = {term.name: term.weight * env.control_dt for term in env.reward_terms}
        self._least = {name: -math.inf if name == "damage" else -most for name, most in weights.items()}
        self._most = {name: 2.0 * most if name == "power" else 0.0 for name, most in weights.items()}
        self._steps = 0

    def reset(self, **arguments: Any) -> np.ndarray:
        """Start an episode; arguments as of `WindTurbineEnv.reset`."""
        observation, info = self.env.reset(**arguments)
        self._steps = 0
        self._check_observation(observation, info["saturated"])
        require(set(info) == _INFO, f"info of reset has the keys {sorted(info)}")
        self._check_info(info)
        self._first_info = info
        self._account = EnergyAccount(self.env.turbine, self.env.episode_wind.inflow, self.env.signals)
        return observation

    def step(self, action: np.ndarray) -> StepResult:
        """Make a step and check everything that it gave."""
        given = action.copy()
        result = StepResult(*self.env.step(action))
        failed = "failure" in result.info
        self._steps += not failed
        require(np.array_equal(given, action), "step changed the action that it was given")
        self._check_observation(result.observation, result.info["saturated"])
        self._check_info(result.info)
        self._check_reward(result)
        self._check_ending(result)
        self._check_costs(result.info)
        self._check_demand()
        if not failed:
            self._check_energy()
        return result

    # ---- spot checks ----

    def snapshot_repeats(self, actions: np.ndarray) -> None:
        """From a snapshot the same actions give the same bits; the episode then stands where it was."""
        env = self.env
        kept = env.snapshot()
        first = self._tried(actions)
        env.restore(kept)
        second = self._tried(actions)
        env.restore(kept)
        require(len(first) == len(second), "an episode ends at another step after restoring a snapshot")
        for k, (one, other) in enumerate(zip(first, second, strict=True)):
            same = np.array_equal(one.observation, other.observation) and one[1:] == other[1:]
            require(same, f"step {k + 1} after restoring a snapshot is another one")

    def _tried(self, actions: np.ndarray) -> list[StepResult]:
        """Steps until the episode ends."""
        results: list[StepResult] = []
        for action in actions:
            if results and (results[-1].terminated or results[-1].truncated):
                break
            results.append(StepResult(*self.env.step(action)))
        return results

    def refuses(self, action: np.ndarray) -> None:
        """An action outside the space is refused and changes nothing."""
        env = self.env
        before, random = env.simulator.state(), copy.deepcopy(env.np_random.bit_generator.state)
        try:
            env.step(action)
        except ActionError:
            pass
        else:
            raise ContractBroken(f"the action {action} was taken")
        require(env.simulator.state() == before, f"the refused action {action} changed the simulator")
        require(env.np_random.bit_generator.state == random, f"the refused action {action} drew random numbers")

    def is_over(self) -> None:
        """After the end of an episode a step asks for a reset."""
        try:
            self.env.step(np.zeros(self.env.layout.action.size))
        except ResetNeeded:
            return
        raise ContractBroken("an episode that is over can be stepped")

    # ---- checks of a step ----

    def _check_observation(self, observation: np.ndarray, saturated: tuple[str, ...]) -> None:
        space, layout = self.env.observation_space, self.env.layout.observation
        require(np.isfinite(observation).all(), f"observation is not finite: {self._wrong(~np.isfinite(observation))}")
        outside = (observation < space.low) | (observation > space.high)
        require(not outside.any(), f"observation is outside of its space: {self._wrong(outside)}")
        require(space.contains(observation), f"observation has type {observation.dtype}, shape {observation.shape}")
        for name in saturated:
            k = layout.index(name)
            at_end = observation[k] in (space.low[k], space.high[k])
            require(at_end, f"{name} is said to be saturated at {observation[k]}")

    def _wrong(self, where: np.ndarray) -> str:
        names = self.env.layout.observation.names
        return ", ".join(names[k] for k in np.flatnonzero(where)[:5])

    def _check_info(self, info: dict[str, Any]) -> None:
        env, signals = self.env, self.env.signals
        require(math.isclose(info["time"], self._steps * env.control_dt, abs_tol=1e-6), f"time is {info['time']} s")
        numbers = [value for key, value in info.items() if key in _INFO and key != "saturated"]
        require(all(math.isfinite(value) for value in numbers), f"info is not finite: {info}")
        require(bool(np.isfinite(signals.values).all()), "signals are not finite")
        for name in ("generator_power", "rotor_speed", "rotor_speed_max"):
            require(info[name] == signals[name], f"info {name} is {info[name]}, the signal {signals[name]}")
        slowest = info["rotor_speed"] - 1e-6 * env.turbine.drivetrain.rated_rotor_speed
        require(info["rotor_speed_max"] >= slowest, "rotor_speed_max is less than rotor_speed")
        least, present = min(signals.tip_clearance_min.tolist()), min(signals.tip_clearance.tolist())
        require(info["tip_clearance_min"] == least, "info tip_clearance_min is not that of the signals")
        require(least <= present + 1e-6, f"tip_clearance_min is {least}, the current clearance {present} m")
        size = env.turbine.rotor_diameter + env.turbine.hub_height
        require(-size < least and present < size, f"clearance {least}, {present} m is beyond the size of the turbine")
        if self._steps:
            for name in ("wind_speed", "wind_seed"):
                require(info[name] == self._first_info[name], f"{name} changes within an episode")

    def _check_reward(self, result: StepResult) -> None:
        terms = dict(result.info["reward_terms"])
        require(math.isfinite(result.reward), f"reward is {result.reward}")
        total = sum(terms.values())
        close = math.isclose(result.reward, total, rel_tol=_ROUNDING, abs_tol=_ROUNDING)
        require(close, f"reward is {result.reward}, the sum of its terms {total}")
        penalty = terms.pop("termination", None)
        require((penalty is not None) == result.terminated, "the term termination does not go with the end")
        require(penalty in (None, -self.env.limits.penalty), f"the penalty for an end is {penalty}")
        require(set(terms) == set(self._least), f"reward has the terms {sorted(terms)}")
        for name, value in terms.items():
            least, most = self._least[name], self._most[name]
            within = least - _ROUNDING <= value <= most + _ROUNDING
            require(within, f"reward term {name} is {value}, its bounds {least} and {most}")

    def _check_ending(self, result: StepResult) -> None:
        env, info = self.env, result.info
        require(not (result.terminated and result.truncated), "terminated and truncated at once")
        reason = info.get("termination")
        require((reason is not None) == result.terminated, f"terminated is {result.terminated}, termination {reason}")
        require(("failure" in info) == (reason == "failure"), "a message of failure without failure, or none with it")
        if reason == "failure":
            require(bool(info["failure"].strip()), "a failure without a message")
            return
        rated = env.turbine.drivetrain.rated_rotor_speed
        due = {
            "overspeed": info["rotor_speed_max"] > env.limits.overspeed * rated,
            "standstill": info["rotor_speed"] < env.limits.standstill * rated,
            "tower_strike": info["tip_clearance_min"] <= 0.0,
        }
        expected = next((name for name, holds in due.items() if holds), None)
        require(reason == expected, f"the episode should have ended by {expected}, and ended by {reason}")
        last = env.length.steps is not None and self._steps >= env.length.steps
        require(result.truncated == (last and reason is None), f"truncated is {result.truncated} at {info['time']} s")

    def _check_costs(self, info: dict[str, Any]) -> None:
        costs = info["costs"]
        require(tuple(costs) == COST_NAMES, f"there are the costs {tuple(costs)}")
        require(all(0.0 <= value <= 1.0 for value in costs.values()), f"costs are {costs}")
        require(math.isclose(info["cost"], sum(costs.values()), abs_tol=_ROUNDING), f"cost {info['cost']} of {costs}")

    def _check_demand(self) -> None:
        action, demand = self.env.layout.action, self.env.demand
        (low, high), (least, most) = action.pitch_limits, action.torque_limits
        pitch = np.asarray(demand.pitch)
        within = bool(np.all((low - _ROUNDING <= pitch) & (pitch <= high + _ROUNDING)))
        require(within, f"the demanded pitch is {pitch} rad, its limits {low} and {high}")
        torque = demand.generator_torque
        require(least <= torque <= most * (1.0 + _ROUNDING), f"the demanded torque is {torque} N m of at most {most}")
        turning = abs(demand.yaw_rate) <= action.max_yaw_rate * (1.0 + _ROUNDING)
        require(turning, f"the demanded yaw rate is {demand.yaw_rate} rad/s")

    def _check_energy(self) -> None:
        balance = cast("Simulator", self.env.simulator).coupling.exchange.energy
        require(
            balance.gained[0] <= balance.reserve,
            f"the structure gained {balance.gained[0]} J more than the work done on it",
        )
        excess = balance.excess_energy[0]
        require(excess <= balance.excess_limit, f"the air gave {excess} J beyond Betz's limit")
        account = self._account
        account.take(self.env.signals, self.env.control_dt)
        require(
            not account.exceeded,
            f"energy beyond Betz's limit must be at most {account.excess_limit / 1e6:.4g} MJ, got "
            f"{account.excess / 1e6:.4g} MJ",
        )
