"""Fuzzed episodes, and what they bring to light."""

import copy
import itertools
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from fuzzing.cases import FuzzCase, draw_case
from fuzzing.contract import Contract, ContractBroken
from fuzzing.policies import make_policy
from wt_gym.base.errors import SimulationError
from wt_gym.envs.turbine_env import WindTurbineEnv

CASE_STEPS = 400
"""Steps of a case: one or two whole episodes, more of short ones."""
_SNAPSHOTS, _REFUSALS = 0.01, 0.005
"""Shares of the steps before which a snapshot or a wrong action is tried."""
_TRIED = 4  # steps from a snapshot


@dataclass(frozen=True)
class Finding:
    """Something that should not have happened, or that the simulator gave up."""

    kind: str
    """``contract``: the environment broke its contract; ``exception``: it raised what it does not document;
    ``failure``: the simulation ended with a clear message, as documented; ``start``: no steady state to start from."""
    case: FuzzCase
    step: int
    message: str

    @property
    def is_fault(self) -> bool:
        """Whether it breaks what is promised."""
        return self.kind in ("contract", "exception")


@dataclass
class CaseResult:
    """Steps, episodes and their endings, and findings of a case."""

    case: FuzzCase
    steps: int = 0
    episodes: int = 0
    endings: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)


def fuzz(
    steps: int,
    turbines: Sequence[str],
    first: int = 0,
    fidelity: str = "training",
    on_finding: Callable[[Finding], None] | None = None,
) -> Iterator[CaseResult]:
    """Run cases one after the other, from number ``first`` on, until so many steps are made; findings as they come."""
    made = 0
    for number in itertools.count(first):
        if made >= steps:
            return
        result = run_case(draw_case(number, turbines, fidelity), min(CASE_STEPS, steps - made), on_finding)
        made += max(result.steps, 1)
        yield result


def run_case(
    case: FuzzCase, steps: int = CASE_STEPS, on_finding: Callable[[Finding], None] | None = None
) -> CaseResult:
    """Run a case; a fault ends it."""
    result = CaseResult(case)

    def found(kind: str, message: str) -> None:
        finding = Finding(kind, case, result.steps, " ".join(message.split()))
        result.findings.append(finding)
        if on_finding is not None:
            on_finding(finding)

    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # of numpy, which announce numbers without meaning
        try:
            _play(case, steps, result, found)
        except ContractBroken as broken:
            found("contract", str(broken))
        except Exception as error:  # whatever comes is what is looked for
            place = traceback.extract_tb(error.__traceback__)[-1]
            found("exception", f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})")
    return result


def _play(case: FuzzCase, steps: int, result: CaseResult, found: Callable[[str, str], None]) -> None:
    """Episodes of a case."""
    rng = np.random.default_rng([case.number, 8])
    env = WindTurbineEnv(**copy.deepcopy(case.arguments))
    contract = Contract(env)
    policy = make_policy(case.policy, env, rng)
    size = env.layout.action.size
    over, observation = True, None
    while result.steps < steps:
        start = over
        if over:
            if result.episodes > steps:  # where no start succeeds
                return
            result.episodes += 1
            options = _odd_start(env, rng) if case.odd_starts and rng.random() < 0.5 else None
            try:
                observation = contract.reset(seed=int(rng.integers(2**31)), options=options)
            except SimulationError as error:
                found("start", str(error))
                result.steps += 1
                continue
        if rng.random() < _SNAPSHOTS:
            contract.snapshot_repeats(rng.uniform(-1.0, 1.0, (_TRIED, size)).astype(np.float32))
        if rng.random() < _REFUSALS:
            contract.refuses(_wrong_action(size, rng))
        answer = contract.step(policy(cast(np.ndarray, observation), start))
        observation, over = answer.observation, answer.terminated or answer.truncated
        result.steps += 1
        if over:
            result.endings[answer.info.get("termination", "time")] += 1
            contract.is_over()
            if "failure" in answer.info:
                found("failure", answer.info["failure"])
    env.close()


def _odd_start(env: WindTurbineEnv, rng: np.random.Generator) -> dict[str, float]:
    """A start away from an operating point, within what can be asked for."""
    drivetrain, pitch = env.turbine.drivetrain, env.turbine.pitch
    return {
        "rotor_speed": float(rng.uniform(0.0, 1.15)) * drivetrain.rated_rotor_speed,
        "pitch": float(rng.uniform(max(pitch.min_pitch, -0.1), min(pitch.max_pitch, 1.5))),
        "azimuth": float(rng.uniform(0.0, 6.28)),
    }


def _wrong_action(size: int, rng: np.random.Generator) -> np.ndarray:
    """An invalid action: wrong size, not finite or out of bounds."""
    if rng.random() < 0.2:
        return np.zeros(size + 1)
    action = rng.uniform(-1.0, 1.0, size)
    action[rng.integers(size)] = rng.choice([np.nan, np.inf, -np.inf, 1.001, -2.0])
    return action
