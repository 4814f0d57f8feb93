"""Design load cases: the runs of each, and the factors by which loads become design loads.

Cases and factors are those of IEC 61400-1, edition 3 (2005) with amendment 1 (2010), table 2 (design load cases) and
table 3 (partial safety factors for loads, γ_f); edition 4 (2019) keeps them for the cases that are run here and rewords
2.1 and 2.2. The wind models are those of `wt_gym.wind.iec`. Characteristic values follow 7.6.2 of edition 3: what
is worst in a transient, averaged over the azimuths of the rotor; the mean over the seeds of what is worst in
turbulence, of the larger half of the seeds in 2.1 and 2.2.

What the standard leaves to the designer is chosen here, and said in ``docs/loadcases.md``: how the turbine notices a
fault and stops, which sensors are wrong by how much, when in a gust things happen, how the wind stands to the rotor.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from wt_gym.control.design import reference_flap_moment
from wt_gym.envs.options import WindOptions
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, WindSampler
from wt_gym.experiment.benchmark_tasks import transient_inflow
from wt_gym.experiment.store import described
from wt_gym.simulation.drivetrain.faults import DriveFault, GeneratorLoss, SensorBias, ShutDown, StuckPitch
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow
from wt_gym.wind.iec import OPERATING_GUST_DURATION

__all__ = [
    "CASES", "DEFLECTION_FACTOR", "EXTRAPOLATION", "DesignCase", "DesignSituation", "Plan", "inflow_of", "plan_of",
]  # fmt: skip

Fault = DriveFault | SensorBias

NORMAL, ABNORMAL, EXTRAPOLATED = 1.35, 1.1, 1.25
"""Partial safety factors γ_f on unfavorable loads: normal and abnormal design situations (table 3), and production in
normal turbulence, where the load is extrapolated to 50 years (DLC 1.1)."""
EXTRAPOLATION = 1.5
"""What the mean of the ten-minute extremes of DLC 1.1 is multiplied with in place of a statistical extrapolation
(amendment 1, 7.6.2: for moments of the blade root and the deflection of the tip)."""
DEFLECTION_FACTOR = 1.1
"""Material factor γ_m on the stiffness behind a tip deflection (7.6.5); the factor of consequence is 1.0 for blades."""

SKIP = 30.0
"""Start of a run that is left out, in which the wake forms [s]."""
EVENT = 40.0
"""Time at which a transient or a fault begins [s]."""
YAW_ERRORS = (0.0, -8.0, 8.0)
"""Directions of the wind against the nacelle in turbulence, from one seed to the next [deg]."""
DETECTION, STUCK_DETECTION = 0.2, 5.0
"""From the loss of the generator, and from a blade that sticks, to the shut-down that follows [s]."""
NORMAL_STOP = 0.5
"""Pitch rate of a normal shut-down in greatest pitch rates; that of an emergency is the greatest."""
SPEED_READS, MOMENT_READS = 0.95, 0.25
"""What a wrong sensor of rotor and generator speed reads of the truth, and what a wrong one of a blade's flapwise root
moment adds, in reference moments (`wt_gym.control.design.reference_flap_moment`)."""
GUST_TIMES = (0.0, 0.25, 0.375, 0.5)
"""When in an operating gust the turbine is stopped, in durations of the gust: at its beginning, in the dip, where it
rises fastest, at its peak."""
_FAULT_LENGTH, _GUST_LENGTH, _ECD_LENGTH = 65.0, 30.0, 40.0


@dataclass(frozen=True)
class DesignSituation:
    """A run of a load case: wind, faults and length. Plain values, which can be hashed."""

    wind: str
    """Turbulent "NTM", "ETM" or "EWM"; "EOG", "ECD+", "ECD-", "EWS-vertical+" and the like: transients that begin
    at `EVENT`. The turbine is parked in "EWM"."""
    speed: float  #: mean wind speed at the hub [m/s]
    duration: float  #: [s]
    seed: int | None = None  #: of the turbulence
    direction: float = 0.0  #: of the wind against the nacelle [deg]
    azimuth: float = 0.0  #: of blade 1 at the start [deg]
    faults: tuple[Fault, ...] = ()  #: of `wt_gym.simulation.drivetrain.faults`
    label: str = ""  #: what fails, in words
    turbulence: str = "kaimal"  #: one of "kaimal", "mann". Spectra of a turbulent wind

    @property
    def parked(self) -> bool:
        """Whether the rotor idles with feathered blades, so that nobody controls it."""
        return self.wind == "EWM"

    @property
    def group(self) -> tuple[str, float, str]:
        """Of what this is one realization, among others with other seeds, directions and azimuths."""
        return self.wind, self.speed, self.label

    @property
    def name(self) -> str:
        """What is worst, in a table."""
        words = [self.wind, f"{self.speed:g} m/s", self.label]
        return ", ".join(filter(None, words))

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values."""
        faults = [{"kind": type(fault).__name__, **asdict(fault)} for fault in self.faults]
        values: dict[str, Any] = described(asdict(self) | {"faults": faults}, "situation")
        return values


@dataclass(frozen=True)
class Plan:
    """How much of each case is run."""

    speeds: tuple[float, ...]  #: mean wind speeds of the cases over the whole range [m/s]
    fault_speeds: tuple[float, ...]  #: those with faults in turbulence [m/s]
    shear_speeds: tuple[float, ...]  #: those of extreme shear [m/s]
    gust_speeds: tuple[float, ...]  #: those of the coherent gust [m/s]
    stop_speeds: tuple[float, ...]  #: those of a stop in a gust [m/s]
    seeds: int  #: realizations a speed in turbulence, at most 6
    events: int  #: realizations a speed and fault, at most 12
    length: float  #: measured part of a turbulent run [s]
    azimuths: tuple[float, ...]  #: of blade 1 at the start of a transient [deg]
    gust_times: tuple[float, ...]  #: of `GUST_TIMES`


def plan_of(turbine: Turbine, quick: bool = False) -> Plan:
    """Plan for a turbine: all of it, or enough to see whether an agent comes through.

    The quick one has three speeds, two seeds of 100 s, one azimuth and two times of a gust.
    """
    rated, out = turbine.rated_wind_speed, turbine.cut_out
    speeds = tuple(float(v) for v in range(2 * math.ceil(0.5 * turbine.cut_in), math.floor(out) + 1, 2))
    if not quick:
        gusts = (rated - 2.0, rated, rated + 2.0)
        return Plan(speeds, speeds, speeds, gusts, (gusts[0], gusts[2], out), 6, 12, 600.0, (0.0, 30.0, 60.0, 90.0),
                    GUST_TIMES)  # fmt: skip
    targets = (0.75 * rated, rated + 0.6, 0.5 * (rated + out))
    few = tuple(sorted({min(speeds, key=lambda speed: abs(speed - target)) for target in targets}))
    return Plan(few, few[1:], few[1:], (rated,), (rated + 2.0,), 2, 2, 100.0, (0.0,), GUST_TIMES[1::2])


@dataclass(frozen=True)
class DesignCase:
    """A design load case."""

    title: str
    situations: Callable[[Turbine, Plan], list[DesignSituation]]  #: gives the runs for a turbine and a `Plan`
    factor: float | None = NORMAL  #: γ_f; None where fatigue is what counts
    larger_half: bool = False  #: whether the mean is that of the larger half of the realizations

    @property
    def fatigue(self) -> bool:
        """Whether fatigue is what counts."""
        return self.factor is None

    @property
    def extrapolated(self) -> bool:
        """Whether loads are extrapolated to 50 years."""
        return self.factor == EXTRAPOLATED


def _turbulent(wind: str, first: int, turbine: Turbine, plan: Plan) -> list[DesignSituation]:
    """Production in turbulence, with the held-out seeds from number ``first`` on."""
    return [
        DesignSituation(wind, speed, SKIP + plan.length, seed, YAW_ERRORS[k % len(YAW_ERRORS)])
        for speed in plan.speeds
        for k, seed in enumerate(EVALUATION_WIND_SEEDS[first : first + plan.seeds])
    ]


def _transients(
    winds: tuple[str, ...], which: str, length: float, turbine: Turbine, plan: Plan
) -> list[DesignSituation]:
    """Production in a transient, from several azimuths."""
    return [
        DesignSituation(wind, speed, EVENT + length, azimuth=azimuth)
        for speed in getattr(plan, which)
        for wind in winds
        for azimuth in plan.azimuths
    ]


def _in_turbulence(
    faults: Callable[[Turbine], dict[str, tuple[Fault, ...]]], turbine: Turbine, plan: Plan
) -> list[DesignSituation]:
    """A fault in normal turbulence."""
    return [
        DesignSituation("NTM", speed, EVENT + _FAULT_LENGTH, seed, faults=what, label=label)
        for speed in plan.fault_speeds
        for label, what in faults(turbine).items()
        for seed in EVALUATION_WIND_SEEDS[12 : 12 + plan.events]
    ]


def _in_gust(
    label: str, faults: Callable[[Turbine, float], tuple[Fault, ...]], turbine: Turbine, plan: Plan
) -> list[DesignSituation]:
    """Something that happens at several times of an operating gust."""
    return [
        DesignSituation("EOG", speed, EVENT + _GUST_LENGTH, azimuth=azimuth, faults=faults(turbine, EVENT + time),
                        label=f"{label} {time:.1f} s after its beginning")
        for speed in plan.stop_speeds
        for time in (share * OPERATING_GUST_DURATION for share in plan.gust_times)
        for azimuth in plan.azimuths
    ]  # fmt: skip


def _parked(turbine: Turbine, plan: Plan) -> list[DesignSituation]:
    """A parked turbine in the turbulent extreme wind of 50 years."""
    speed = _sampler(turbine, "extreme-turbulent").speeds[0]
    return [
        DesignSituation("EWM", speed, SKIP + plan.length, seed, YAW_ERRORS[k % len(YAW_ERRORS)])
        for k, seed in enumerate(EVALUATION_WIND_SEEDS[: plan.seeds])
    ]


def _grid_loss(turbine: Turbine, time: float) -> tuple[Fault, ...]:
    """The generator is lost; the turbine notices and stops as fast as it can."""
    return GeneratorLoss(time), ShutDown(time + DETECTION, turbine.pitch.max_rate)


def _control_faults(turbine: Turbine) -> dict[str, tuple[Fault, ...]]:
    """Loss of the grid, and sensors that read wrong for the rest of the run."""
    moment = MOMENT_READS * reference_flap_moment(turbine)
    return {
        "grid loss": _grid_loss(turbine, EVENT),
        "rotor speed reads low": (SensorBias(EVENT, ("rotor_speed", "generator_speed"), SPEED_READS),),
        "flap moment of blade 1 reads high": (SensorBias(EVENT, ("root_flap_moment_1",), 1.0, moment),),
    }


def _stuck(turbine: Turbine) -> dict[str, tuple[Fault, ...]]:
    """One blade sticks; the turbine notices late and feathers the others."""
    stop = ShutDown(EVENT + STUCK_DETECTION, turbine.pitch.max_rate)
    return {"blade 1 stuck": (StuckPitch(EVENT, 1), stop)}


def _normal_stop(turbine: Turbine, time: float) -> tuple[Fault, ...]:
    """A shut-down as every day has it."""
    return (ShutDown(time, NORMAL_STOP * turbine.pitch.max_rate),)


_SHEARS = ("EWS-vertical+", "EWS-vertical-", "EWS-horizontal+", "EWS-horizontal-")
CASES = {
    "1.1": DesignCase("Production, normal turbulence, extrapolated", partial(_turbulent, "NTM", 0), EXTRAPOLATED),
    "1.2": DesignCase("Production, normal turbulence, fatigue", partial(_turbulent, "NTM", 0), None),
    "1.3": DesignCase("Production, extreme turbulence", partial(_turbulent, "ETM", 6)),
    "1.4": DesignCase(
        "Coherent gust with change of direction", partial(_transients, ("ECD+", "ECD-"), "gust_speeds", _ECD_LENGTH)
    ),
    "1.5": DesignCase("Extreme shear", partial(_transients, _SHEARS, "shear_speeds", _GUST_LENGTH)),
    "2.1": DesignCase("Grid loss or a wrong sensor", partial(_in_turbulence, _control_faults), larger_half=True),
    "2.2": DesignCase("A blade stuck", partial(_in_turbulence, _stuck), ABNORMAL, larger_half=True),
    "2.3": DesignCase("Grid loss in an operating gust", partial(_in_gust, "grid loss", _grid_loss), ABNORMAL),
    "4.2": DesignCase("Shut-down in an operating gust", partial(_in_gust, "stop", _normal_stop)),
    "6.1": DesignCase("Parked, extreme wind of 50 years", _parked),
}
"""Design load cases by number."""


def inflow_of(situation: DesignSituation, turbine: Turbine) -> Inflow:
    """Wind of a run; a `wt_gym.base.errors.InflowError` if the turbine has no class of IEC 61400-1."""
    direction, rng = math.radians(situation.direction), np.random.default_rng(0)
    if situation.wind == "EWM":
        sampler = _sampler(turbine, "extreme-turbulent", direction=direction, turbulence=situation.turbulence)
        return sampler.sample(rng, wind_seed=situation.seed).inflow
    if situation.wind in ("NTM", "ETM"):
        options = {"turbulence_model": situation.wind, "turbulence": situation.turbulence}
        sampler = _sampler(turbine, "turbulent", direction=direction, **options)
        return sampler.sample(rng, wind_speed=situation.speed, wind_seed=situation.seed).inflow
    sign = -1 if situation.wind.endswith("-") else 1
    return transient_inflow(turbine, situation.wind.rstrip("+-"), situation.speed, sign, EVENT)


def _sampler(turbine: Turbine, kind: str, **options: Any) -> WindSampler:
    return WindSampler(turbine, WindOptions(kind, (turbine.cut_in, turbine.cut_out), **options))
