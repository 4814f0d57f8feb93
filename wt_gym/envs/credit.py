"""Credit: what an action does to the loads of the next seconds counts in the step of the action.

A tower rings for half a minute and a wake takes seconds, so the effects of an action come in the rewards of many later
steps, among those of all other actions: a gradient from them is mostly noise. The potential

    P_t = sum_(k=1..n) [r(z_(t+k) + y_(t+k)) - r(z_(t+k))]

is the reward that the actions up to t will have changed in the next n steps if no other follows: z are the loads of the
controller alone, which a relative reward records anyway, ahead of the turbine; y is the response to past offsets by the
impulse responses of the observer among the parts of the base controller; r are the fatigue terms. A step is paid

    r_t + P_(t+1) - P_t,

which is the change that its own action makes, plus what the model has forecast wrongly. Differences of a potential add
up to its last value, whatever the actions were, so the return of an episode is that of the rewards alone, with the
effects beyond its end: without a discount no policy gains by them (Ng, Harada, Russell, ICML 1999). There is none in
the differences either, on purpose: a learner that discounts sees the whole effect of its action all the same.
"""

from collections.abc import Iterable
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from wt_gym.control.controllers import Controller
from wt_gym.control.controllers.linear_optimal import LinearDesign, LoadObserver, linear_part, side_sign
from wt_gym.envs.credit_kernels import effect_to_come
from wt_gym.envs.fatigue import LOADS, BladeFatigue, TowerForeAftFatigue, TowerSideSideFatigue
from wt_gym.envs.operation import Operation
from wt_gym.envs.terms import Beginning, RewardTerm, Term
from wt_gym.envs.twin import Twin
from wt_gym.turbines import Turbine

FATIGUE = (BladeFatigue, TowerForeAftFatigue, TowerSideSideFatigue)
HORIZON = 15.0
"""Time in which the effects of an offset count [s]."""


def fatigue_weights(terms: Iterable[RewardTerm]) -> NDArray[np.float64]:
    """Weights (4,) of `wt_gym.envs.credit_kernels.fatigue_rate`; a ValueError where two terms are of one kind."""
    weights, found = np.zeros(4), [term for term in terms if isinstance(term, FATIGUE)]
    if any(sum(isinstance(term, kind) for term in found) > 1 for kind in FATIGUE):
        raise ValueError("reward_credit and linear models need at most one fatigue term of a kind")
    for term in found:
        if isinstance(term, BladeFatigue):
            weights[:2] = term.weight, term.fixed_frame
        for k, kind in enumerate((TowerForeAftFatigue, TowerSideSideFatigue), start=2):
            if isinstance(term, kind):
                weights[k] = term.weight
    return weights


def without_mean(series: NDArray[np.float64], dt: float, time_constant: float) -> NDArray[np.float64]:
    """Series (..., n) behind the high-pass filter of `wt_gym.envs.terms.HighPass`, zero before."""
    kept = np.exp(-dt / time_constant)
    return np.asarray(series - lfilter([1.0 - kept], [1.0, -kept], series, axis=-1))


def as_in_terms(
    loads: NDArray[np.float64], turbine: Turbine, terms: Iterable[RewardTerm], dt: float
) -> NDArray[np.float64]:
    """Series of `wt_gym.envs.fatigue.LOADS` (m, 5, ..., n) [N m] as terms normalize and filter them, zero before."""
    found = loads.copy()
    for term in terms:
        if isinstance(term, FATIGUE):
            rows, washed = term.rows
            found[:, rows] /= term.reference(turbine)
            found[:, washed] = without_mean(found[:, washed], dt, term.time_constant)
    return found


def held_responses(responses: NDArray[np.float64], times: int, length: int) -> NDArray[np.float64]:
    """Responses (..., length) to offsets that are held over ``times`` samples, at the ends of such times.

    Entry l of the responses (..., n_taps) is the effect of an offset of one sample l + 1 samples later.
    """
    sums = np.concatenate([np.zeros((*responses.shape[:-1], 1)), np.cumsum(responses, axis=-1)], axis=-1)
    ends = np.minimum(np.arange(times, times * length + 1, times), responses.shape[-1])
    starts = np.minimum(np.arange(0, times * length, times), responses.shape[-1])
    return np.asarray(sums[..., ends] - sums[..., starts])


def steps_of_observer(design: LinearDesign, dt: float) -> int:
    """Steps of an observer in a control step [s]; a ValueError where they are no whole number."""
    times = round(dt / design.interval)
    if times < 1 or abs(times * design.interval - dt) > 1e-6 * dt:
        raise ValueError(
            f"control_dt must be a multiple of {design.interval:g} s, the interval of the design of the observer, with "
            f"credit or a linear model, got {dt!r} s"
        )
    return times


def normalized_responses(
    design: LinearDesign, turbine: Turbine, terms: Iterable[RewardTerm], dt: float
) -> NDArray[np.float64]:
    """Responses of `wt_gym.envs.fatigue.LOADS` to offsets held over a step [1/rad], shape (n_knots, n_steps, 5, 3).

    Raises
    ------
    ValueError
        If the step [s] is no multiple of the interval of the design.
    """
    times = steps_of_observer(design, dt)
    flap = design.responses[:, :3] * design.scale[:3, None, None]
    held = held_responses(np.concatenate([flap, design.loads], axis=1), times, round(HORIZON / dt))
    held[:, LOADS.index("tower_side_side")] *= side_sign(turbine)
    return np.ascontiguousarray(as_in_terms(held, turbine, terms, dt).transpose(0, 3, 1, 2))


class Credit(Term):
    """Pays each step the effects to come of its action, see the module.

    Parameters
    ----------
    twin : Twin
        The controller alone, with its loads.
    terms : sequence of RewardTerm
    dt : float
        Control step [s].
    dialed : bool
        A dial moves the weights.

    Raises
    ------
    ValueError
        If the base controller has no observer, its design does not fit the step, or the terms have no fixed weights.
    """

    remembered = ("_changes", "_first", "_before")

    def __init__(
        self, twin: Twin, terms: tuple[RewardTerm, ...], turbine: Turbine, operation: Operation, dt: float, dialed: bool
    ):
        part = linear_part(operation.controller)
        if part is None:
            raise ValueError(
                "reward_credit needs a base controller with an observer, such as "
                "controller='discon+side_side_damper+observer', or must be False"
            )
        if dialed:
            raise ValueError("reward_credit must be False with dial_weights: it needs fixed weights of the fatigue")
        self._twin, self._operation, self._dt = twin, operation, dt
        self._weights = fatigue_weights(terms)
        self._responses = normalized_responses(part.design, turbine, terms, dt)
        self._times = round(dt / part.design.interval)
        self._scratch = np.empty(5)
        self._forget()
        twin.lead = len(self._changes)

    def _forget(self) -> None:
        self._changes, self._first, self._before = np.zeros(self._responses.shape[1:3]), 0, 0.0

    def begin(self, _: Beginning) -> None:
        """Start an episode: no offset has acted."""
        self._forget()

    def adjust(self, reward: float, terms: dict[str, float], step: int, _: float) -> tuple[float, dict[str, float]]:
        """Add what the action of the step changes in the steps to come; an early end takes back all that was paid."""
        part = cast(LoadObserver, linear_part(cast("Controller", self._operation.controller)))
        size, acted = len(self._changes), part.acted()[:, : self._times].mean(1)
        response = sum(share * self._responses[k] for k, share in part.place())
        added = response @ acted
        self._changes[self._first :] += added[: size - self._first]
        self._changes[: self._first] += added[size - self._first :]
        self._changes[self._first] = 0.0  # that of this step stands in its reward
        self._first = (self._first + 1) % size
        effect = 0.0
        if "termination" not in terms:
            loads = self._twin.loads(step + 1)
            effect = effect_to_come(loads, self._changes, self._first, self._weights, self._scratch)
        credit = self._dt * (effect - self._before)
        self._before = effect
        return reward + credit, terms | {"credit": credit}
