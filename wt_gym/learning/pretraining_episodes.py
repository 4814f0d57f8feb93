"""Episodes as a pretraining records them, and what another policy would have cost in them.

About the offsets u of the policy that was recorded, loads are linear in the offsets of another one,

    y(u') = y + G * (u' - u),

with impulse responses G that were identified under the same base controller. The cost is the weighted lifetime cost
(`wt_gym.analysis.metrics`) over that of the published controller in the same wind speed, with the fatigue as
rainflow counting gives it, so it is exact for the recorded policy and its gradient is that of the model. With a dial
(`wt_gym.envs.dial`) its factors weigh the parts of the cost as they weigh those of the reward.

Rainflow counting pairs samples. With cycles of range S_i and count n_i, L = (sum n_i S_i^m / N)^(1/m). As long as no
turning point changes its partner, S_i is the difference of two samples, so the gradient of L by the samples is exact
almost everywhere.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numba
import numpy as np
import torch
from numpy.typing import NDArray

from wt_gym.analysis.metrics import BLADE_EXPONENT, FLOATING_COST_WEIGHTS, TOWER_EXPONENT
from wt_gym.base.errors import SimulationError
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Readings
from wt_gym.control.controllers.fault_supervisor import fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import OFFSET_ACTIONS, linear_part, series_in_fixed_frame, side_sign
from wt_gym.control.controllers.names import BASELINE
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.envs.episode import Agent
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.run import EpisodePlayer
from wt_gym.learning.options import without_observer
from wt_gym.learning.recording import floating_loads
from wt_gym.simulation.drivetrain.drives import pitch_delay

_ENDLESS = 10**9  # control steps
Actor = Callable[[torch.Tensor], torch.Tensor]
"""Policy: actions (n, 3) of observations (n, n_obs)."""


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """An episode; sample k of the loads is that of the instant at which action k is chosen, the last one has none."""

    speed: float
    """Mean wind [m/s]."""
    seed: int
    dt: float
    """Control step [s]."""
    observations: NDArray[np.float32]
    """Shape (n, n_obs)."""
    offsets: NDArray[np.float64]
    """Mean, tilt and yaw by which the demands differ from those of the base controller [rad]. Shape (3, n)."""
    share: NDArray[np.float64]
    """In which offsets of the agent act. Shape (n,)."""
    flap: NDArray[np.float64]
    edge: NDArray[np.float64]
    pitch: NDArray[np.float64]
    """flap, edge, pitch: root moments [N m], pitch [rad]. Shape (n_blades, n + 1)."""
    tower: NDArray[np.float64]
    """Fore-aft and side-side moment at the base [N m]. Shape (2, n + 1)."""
    platform: NDArray[np.float64]
    """Pitch of a floating platform about the axis across the nacelle [rad]. Shape (1, n + 1), on land (0, n + 1)."""
    power: NDArray[np.float64]
    """Of the generator [W]. Shape (n + 1,)."""
    azimuth: NDArray[np.float64]
    """In the sense of rotation [rad]. Shape (n + 1,)."""
    read_azimuth: NDArray[np.float64]
    read_speed: NDArray[np.float64]
    """read_azimuth, read_speed: azimuth and rotor speed by the readings, in whose frame offsets are chosen [rad],
    [rad/s]. Shape (n,)."""
    individual: NDArray[np.float64]
    """Share of tilt and yaw that a supervisor of faults leaves. Shape (n,)."""
    lead: float
    """Time by which the azimuth of the recorded pitch is ahead of that at which an offset was chosen, with the drives
    of the episode [s]."""
    pitch_gain: float = 1.0
    """Motion of the blades over that of their demand [-]."""

    @property
    def steps(self) -> int:
        """N."""
        return int(self.offsets.shape[1])


@dataclass(frozen=True)
class EpisodeJob:
    """An episode to be recorded, from the beginning of its turbulence."""

    env_id: str
    arguments: str
    """Of the environment, as JSON."""
    speed: float
    """[m/s]."""
    seed: int
    """Of the turbulence."""
    duration: float
    """[s]."""
    agent: Agent | None = None
    """None: actions of zero."""
    baseline: bool = False
    """Under the controller of the id instead of the base controller: the published one, with a task's additions."""
    dial: tuple[float, ...] | None = None
    """Factors of `wt_gym.envs.dial`, for the whole episode."""
    condition: str = "{}"
    """Further arguments of the environment, as JSON; those of ``arguments`` have no faults."""


class PlayedActions:
    """Agent that plays actions (n, n_act), then zeros, whatever it sees."""

    def __init__(self, actions: NDArray[np.float64]) -> None:
        self.actions, self._count = actions.astype(np.float32), 0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Next action."""
        k = self._count
        self._count += 1
        return (self.actions[k] if k < len(self.actions) else np.zeros_like(self.actions[0])), state


class _Watched:
    """Agent whose observations are kept, and the frame in which its offsets act: that of the readings."""

    def __init__(self, agent: Agent, env: WindTurbineEnv) -> None:
        self.agent, self._env = agent, env
        self.seen: list[NDArray[np.float32]] = []
        self.frame: list[tuple[float, float]] = []

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        self.seen.append(np.array(observation, dtype=np.float32))
        readings: Readings = self._env.operation.readings()
        if (watcher := fault_supervisor_of(self._env.controller)) is not None:
            readings = watcher.believed(readings)
        self.frame.append((readings["azimuth"], readings["rotor_speed"]))
        return self.agent.predict(observation, state=state, episode_start=episode_start, deterministic=deterministic)


def check_environment(env: WindTurbineEnv) -> None:
    """Refuse an environment in which actions have an effect on later observations that no model takes away."""
    chosen = env.options.actions
    if not (chosen.mode == "residual" and chosen.pitch == "fixed-frame" and chosen.residual == "offset"):
        raise ValueError(
            "pretraining needs action_mode='residual', pitch='fixed-frame' and residual_form='offset', got "
            f"{chosen.mode!r}, {chosen.pitch!r} and {chosen.residual!r}"
        )
    if tuple(env.layout.action.names) != OFFSET_ACTIONS:
        raise ValueError(f"pretraining needs the actions mean, tilt and yaw alone, got {list(env.layout.action.names)}")
    if linear_part(env.controller) is None:
        raise ValueError(
            "pretraining needs a base controller with linear_pitch, such as controller='linear_optimal': it takes the "
            "effect of the agent's offsets off what is measured"
        )
    names = env.layout.observation.names
    # a lidar reads the wind without the rotor's induction, from a nacelle that no action turns; the fit of the model
    # moves over half a minute, and is taken as given
    independent = ("disturbance_", "linear_pitch_", "model_", "lidar_", "dial_")
    if foreign := [name for name in names if not name.startswith(independent)]:
        raise ValueError(
            "pretraining needs observations that do not depend on the actions: observation=['disturbances'], in "
            "conditions ['disturbances', 'model_fit'], with a lidar ['disturbances', 'lidar'], with a dial "
            "['disturbances', 'dial'], got "
            f"{', '.join(foreign[:5])}"
        )
    if env.operation.count != 1:
        raise ValueError(f"pretraining needs control_dt={env.operation.step:g}, the step of the simulator")
    if env.options.variation.varies or env.sensors == "all":
        raise ValueError("pretraining needs one plant and exact sensors: leave out variation and sensors='all'")
    if env.options.observations.history != 1 or env.options.observations.delay:
        raise ValueError("pretraining needs history=1 and sensor_delay=0")


@lru_cache(maxsize=12)
def _environment(env_id: str, arguments: str, baseline: bool, condition: str) -> gym.Env[Any, Any]:
    """Environment that a process keeps."""
    given: dict[str, Any] = {k: value for k, value in json.loads(arguments).items() if not k.startswith("fault_")}
    given |= {"relative_reward": False, "reward_credit": False, "fault_kinds": None}
    given["episode_length"] = None  # a job has its own duration
    given |= json.loads(condition)
    if baseline:
        published = without_observer(registered_arguments(env_id, {}).get("controller", BASELINE))
        given |= {"controller": published, "observation": ["rotor"], "residual_fade": False, "residual_washout": None}
    env = gym.make(env_id, max_episode_steps=_ENDLESS, **given)
    turbine_env_of(env).outer_steps = _ENDLESS
    return env


def record_episode(job: EpisodeJob) -> RecordedEpisode:
    """Play an episode and record it; a SimulationError where it ends early."""
    env = _environment(job.env_id, job.arguments, job.baseline, job.condition)
    plain = turbine_env_of(env)
    agent = _Watched(job.agent or ConstantAgent(plain.layout), plain)
    demands: list[tuple[Demand, Demand]] = []
    share: list[float] = []
    individual: list[float] = []

    options: dict[str, Any] = {"wind_speed": job.speed, "wind_seed": job.seed, "time_offset": 0.0}
    if job.dial is not None:
        options["dial"] = dict(zip(DIAL_NAMES, job.dial, strict=True))
    player = EpisodePlayer(env, agent, seed=job.seed, options=options, duration=job.duration)
    for _ in player:
        operation = plain.operation
        share.append(1.0 if operation.residual is None else operation.residual.share)
        watcher = fault_supervisor_of(plain.controller)
        individual.append(1.0 if watcher is None else watcher.share)
        demands.append((operation.base, operation.demand))
    done = player.episode
    if done.ending != "time":
        raise SimulationError(
            f"the episode at {job.speed:g} m/s, seed {job.seed}, ended after {done.time:g} s ({done.ending}): "
            "pretraining needs whole episodes; give smaller action_spans"
        )
    data, sign, dt = done.data, side_sign(plain.turbine), plain.control_dt
    blades = range(1, plain.turbine.n_blades + 1)

    def series(name: str) -> NDArray[np.float64]:
        return data[name].values.astype(float)

    part, frame = linear_part(plain.controller), np.array(agent.frame[: len(demands)])
    offsets = np.zeros((len(demands), 3))
    if part is not None:
        for k, (base, demand) in enumerate(demands):
            offsets[k] = part.offsets.between(base, demand, *agent.frame[k], dt)
    return RecordedEpisode(
        speed=job.speed,
        seed=job.seed,
        dt=dt,
        observations=np.stack(agent.seen[: len(share)]),
        offsets=offsets.T.copy(),
        share=np.array(share),
        flap=np.stack([series(f"root_flap_moment_{b}") for b in blades]),
        edge=np.stack([series(f"root_edge_moment_{b}") for b in blades]),
        pitch=np.stack([series(f"pitch_{b}") for b in blades]),
        tower=np.stack([series("tower_base_fore_aft_moment"), sign * series("tower_base_side_side_moment")]),
        platform=floating_loads(data, plain.turbine),
        power=series("generator_power"),
        azimuth=series("azimuth"),
        read_azimuth=frame[:, 0],
        read_speed=frame[:, 1],
        individual=np.array(individual),
        # the demand is ahead by what the nominal drives take; those of the episode take it back, and more
        lead=2.0 * pitch_delay(plain.turbine.pitch, dt) - pitch_delay(plain.simulator.turbine.pitch, dt),
        pitch_gain=1.0 if plain.operation.pitch_gain is None else plain.operation.pitch_gain.gain,
    )


@numba.njit(cache=True)
def cycle_ends(signal: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Cycles of a signal (n,) by rainflow counting (ASTM E1049-85, 5.4.4).

    Samples between which each cycle goes (n_cycles, 2), and counts (n_cycles,): 1, or 0.5 for half cycles.
    """
    n = signal.size
    turning = np.empty(n, np.int64)
    turning[0], size = 0, 1
    for k in range(1, n - 1):
        if (signal[k] - signal[turning[size - 1]]) * (signal[k + 1] - signal[k]) < 0.0:
            turning[size] = k
            size += 1
    turning[size] = n - 1
    size += 1
    ends, counts = np.empty((size, 2), np.int64), np.empty(size)
    stack = np.empty(size, np.int64)
    depth = found = 0
    for j in range(size):
        stack[depth] = turning[j]
        depth += 1
        while depth >= 3:
            last = abs(signal[stack[depth - 1]] - signal[stack[depth - 2]])
            before = abs(signal[stack[depth - 2]] - signal[stack[depth - 3]])
            if last < before:
                break
            ends[found] = stack[depth - 3], stack[depth - 2]
            if depth == 3:  # it holds the start: half a cycle
                counts[found] = 0.5
                stack[0], stack[1] = stack[1], stack[2]
                depth = 2
            else:
                counts[found] = 1.0
                stack[depth - 3] = stack[depth - 1]
                depth -= 2
            found += 1
    for j in range(depth - 1):
        ends[found] = stack[j], stack[j + 1]
        counts[found] = 0.5
        found += 1
    return ends[:found], counts[:found]


def damage_equivalent_load(signal: torch.Tensor, duration: float, exponent: float) -> torch.Tensor:
    """Load of a signal (n,), as of `wt_gym.analysis.metrics.damage_equivalent_load`, with a gradient."""
    ends, counts = cycle_ends(signal.detach().numpy().astype(np.float64))
    ranges = (signal[ends[:, 0]] - signal[ends[:, 1]]).abs()
    largest = ranges.detach().max()  # powers of ten of loads in N m would overflow
    if largest == 0.0:
        return signal.sum() * 0.0
    weighted = torch.from_numpy(counts).to(signal.dtype) * (ranges / largest) ** exponent
    return largest * (weighted.sum() / duration) ** (1.0 / exponent)


OUTPUTS = (
    "flap_mean", "flap_tilt", "flap_yaw", "tower_fore_aft", "tower_side_side", "power", "edge_mean", "edge_tilt",
    "edge_yaw", "platform_pitch",
)  # fmt: skip
"""What impulse responses give [MN m, MW], on a floating turbine the last too [rad]."""

_MEGA = 1e6
_LOOPS = 2
"""Picard iterations of the loop from offsets over observations to offsets."""
_DIALED = {
    "blade_flap_del": "fatigue", "blade_edge_del": "fatigue", "tower_fore_aft_del": "fatigue",
    "tower_side_side_del": "fatigue", "platform_pitch_std": "fatigue", "captured_power": "power",
    "pitch_duty_cycle": "travel",
}  # fmt: skip
"""What of a dial weighs a metric."""


def plant_outputs(episode: RecordedEpisode) -> NDArray[np.float64]:
    """`OUTPUTS` of an episode, (9, n + 1) on land."""
    flap, edge = (series_in_fixed_frame(moments, episode.azimuth) for moments in (episode.flap, episode.edge))
    loads = np.stack([*flap, *episode.tower, episode.power, *edge]) / _MEGA
    return np.concatenate([loads, episode.platform])


class Plants:
    """Impulse responses at several rising mean winds [m/s], between which the wind speed chooses.

    Responses (n, n_out, 3, n_taps) of outputs to mean, tilt and yaw, per radian; entry l is the effect of an offset
    l + 1 steps later. Outputs are `OUTPUTS` [MN m/rad, MW/rad], or observations of the agent.
    """

    def __init__(self, speeds: tuple[float, ...], responses: NDArray[np.float64]) -> None:
        self.speeds, self.responses = speeds, responses
        self._spectra: dict[tuple[float, int], torch.Tensor] = {}

    def at(self, speed: float) -> NDArray[np.float64]:
        """Responses at a mean wind (n_out, 3, n_taps), those of the nearest beyond the ends."""
        x = min(max(speed, self.speeds[0]), self.speeds[-1])
        k = min(int(np.searchsorted(self.speeds, x, side="right")) - 1, max(len(self.speeds) - 2, 0))
        if len(self.speeds) == 1:
            return np.asarray(self.responses[0])
        w = (x - self.speeds[k]) / (self.speeds[k + 1] - self.speeds[k])
        return np.asarray((1.0 - w) * self.responses[k] + w * self.responses[k + 1])

    def respond(self, speed: float, offsets: torch.Tensor) -> torch.Tensor:
        """Changes (n_out, n + 1) by offsets (3, n): sample k follows from the offsets 0 … k - 1."""
        steps = offsets.shape[-1]
        spectrum = self._spectrum(speed, steps)
        size = 2 * (spectrum.shape[-1] - 1)
        product = torch.einsum("ojf,jf->of", spectrum, torch.fft.rfft(offsets, n=size))
        changed = torch.fft.irfft(product, n=size)[:, :steps]
        return torch.cat([torch.zeros(len(changed), 1), changed], 1)

    def _spectrum(self, speed: float, steps: int) -> torch.Tensor:
        """Transform of the responses for a convolution with so many samples, kept."""
        size = 1 << math.ceil(math.log2(steps + self.responses.shape[-1]))
        key = (round(speed, 1), size)
        if key not in self._spectra:
            found = np.fft.rfft(self.at(key[0]), n=size).astype(np.complex64)
            self._spectra[key] = torch.from_numpy(found)
        return self._spectra[key]


@dataclass(frozen=True)
class Limits:
    """From actions to the offsets that act."""

    mean: float
    tilt_yaw: float
    """mean, tilt_yaw: offset at an action of one [rad]."""
    washout: float | None
    """Time constant of the high-pass filter of the mean [s]."""
    full_rate: float
    """Of the pitch drives [rad/s]."""
    rated_power: float
    """[W]."""
    skip: float
    """Start of an episode that does not count [s]."""
    dial_at: tuple[int, ...] = ()
    """Places of the factors of a dial in an observation, in the order of `DIAL_NAMES`; none without a dial."""

    def offsets(self, actions: torch.Tensor, share: torch.Tensor, dt: float) -> torch.Tensor:
        """Offsets (3, n) [rad] of actions (n, 3), as far as shares (3, n) let them; rates have no limit."""
        u = actions.clamp(-1.0, 1.0).T
        mean = self.mean * u[:1]
        if self.washout is not None:
            mean = mean - _low_pass(mean, self.washout, dt)
        return share * torch.cat([mean, self.tilt_yaw * u[1:]])


def _low_pass(series: torch.Tensor, time_constant: float, dt: float) -> torch.Tensor:
    """First-order low-pass (1, n) that starts at zero."""
    n = series.shape[-1]
    kept = math.exp(-dt / time_constant)
    kernel = (1.0 - kept) * kept ** torch.arange(n, dtype=torch.float64)
    size = 1 << math.ceil(math.log2(2 * n))
    product = torch.fft.rfft(series.double(), n=size) * torch.fft.rfft(kernel, n=size)
    passed: torch.Tensor = torch.fft.irfft(product, n=size)[..., :n].to(series.dtype)
    return passed


def load_metrics(
    blades: tuple[torch.Tensor, torch.Tensor], tower: torch.Tensor, pitch: torch.Tensor, dt: float, full_rate: float,
    skip: int, exponents: tuple[float, float], platform: torch.Tensor,
) -> dict[str, torch.Tensor]:  # fmt: skip
    """Metrics of the lifetime cost [MN m], of all blades alike.

    Of flapwise and edgewise moments [MN m] and pitch [rad] (n_blades, n + 1) and tower moments (2, n + 1) [MN m],
    sampled every ``dt`` [s]; the full rate of the pitch is in rad/s, ``skip`` samples at the start do not count, and
    the exponents are those of blades and tower. The pitch of a platform (1, n + 1) is in rad; on land (0, n + 1).
    """
    time = (pitch.shape[1] - skip) * dt
    flap, edge = (
        torch.stack([damage_equivalent_load(row[skip:], time, exponents[0]) for row in moments]).mean()
        for moments in blades
    )
    aft, side = (damage_equivalent_load(row[skip:], time, exponents[1]) for row in tower)
    return {
        "blade_flap_del": flap,
        "blade_edge_del": edge,
        "tower_fore_aft_del": aft,
        "tower_side_side_del": side,
        "pitch_duty_cycle": pitch[:, skip:].diff(dim=1).abs().mean() / dt / full_rate,
        **({"platform_pitch_std": platform[0, skip:].std(correction=0)} if len(platform) else {}),
    }


class LinearizedEpisode:
    """A recorded episode as a function of the policy.

    Parameters
    ----------
    actor : Actor
        Policy under which it was recorded.
    baseline : dict
        Metrics of the published controller in this wind speed.
    seen : Plants, optional
        Responses of what the agent sees to its own offsets, where the model of the base controller does not hold; by
        default there are none.
    """

    def __init__(
        self,
        episode: RecordedEpisode,
        actor: Actor,
        plants: Plants,
        limits: Limits,
        baseline: dict[str, float],
        seen: Plants | None = None,
    ) -> None:
        self._plants, self._seen, self._limits, self._baseline = plants, seen, limits, baseline
        self.speed, self.steps, self._dt = episode.speed, episode.steps, episode.dt
        self._skip = round(limits.skip / episode.dt)
        self.observations = torch.from_numpy(episode.observations)
        cyclic = episode.share * episode.individual
        self._share, self._gain = tensor(np.stack([episode.share, cyclic, cyclic])), episode.pitch_gain
        n = len(episode.flap)
        of_blades = 2.0 * math.pi / n * np.arange(n)[:, None]
        ahead = episode.read_azimuth + episode.lead * episode.read_speed + of_blades
        still = episode.azimuth + of_blades
        self._pitch_cos, self._pitch_sin = tensor(np.cos(ahead)), tensor(np.sin(ahead))
        self._flap_cos, self._flap_sin = tensor(np.cos(still)), tensor(np.sin(still))
        self._flap, self._edge = tensor(episode.flap / _MEGA), tensor(episode.edge / _MEGA)
        self._tower, self._platform = tensor(episode.tower / _MEGA), tensor(episode.platform)
        self._pitch = tensor(episode.pitch)
        power = np.minimum(episode.power, limits.rated_power)
        self._power = float(power[self._skip :].mean()) / _MEGA
        with torch.no_grad():
            self._acted = limits.offsets(actor(self.observations), self._share, self._dt)

    def offsets(self, actor: Actor, noise: float = 0.0, dial: tuple[float, ...] | None = None) -> torch.Tensor:
        """Offsets (3, n) of a policy [rad], with noise of a standard deviation on its observations.

        Where the agent sees its own offsets u, these solve u = pi(o + H * (u - u_recorded)); Picard iterations from the
        recorded observations give them as far as the loop is weak. Factors of a dial replace those of the recording.
        """
        seen = self.observations
        if noise > 0.0:
            seen = seen + noise * torch.randn_like(seen)
        if dial is not None:
            seen = seen.clone()
            seen[:, list(self._limits.dial_at)] = torch.tensor([math.log2(factor) for factor in dial])
        offsets = self._limits.offsets(actor(seen), self._share, self._dt)
        if self._seen is not None:
            for _ in range(_LOOPS):
                back = self._seen.respond(self.speed, offsets - self._acted)[:, : self.steps].T
                offsets = self._limits.offsets(actor(seen + back), self._share, self._dt)
        return offsets

    def metrics(self, offsets: torch.Tensor, exponents: tuple[float, float]) -> dict[str, torch.Tensor]:
        """Metrics under offsets (3, n) [rad]; power is the recorded one less what the offsets take, never more."""
        more = offsets - self._acted
        changed = self._plants.respond(self.speed, more)
        flap, edge = (
            moments + changed[k] + changed[k + 1] * self._flap_cos + changed[k + 2] * self._flap_sin
            for k, moments in ((0, self._flap), (6, self._edge))
        )
        moved = self._gain * (more[0] + more[1] * self._pitch_cos + more[2] * self._pitch_sin)
        pitch = torch.cat([self._pitch[:, :1], self._pitch[:, 1:] + moved], 1)
        full_rate, tower = self._limits.full_rate, self._tower + changed[3:5]
        platform = self._platform + changed[9:]
        found = load_metrics((flap, edge), tower, pitch, self._dt, full_rate, self._skip, exponents, platform)
        found["captured_power"] = self._power + changed[5, self._skip :].mean().clamp(max=0.0)
        return found

    def cost(
        self,
        offsets: torch.Tensor,
        exponents: tuple[float, float] = (BLADE_EXPONENT, TOWER_EXPONENT),
        dial: tuple[float, ...] | None = None,
    ) -> torch.Tensor:
        """Lifetime cost under offsets (3, n) [rad], as of `cost_and_travel`."""
        return self.cost_and_travel(offsets, exponents, dial)[0]

    def cost_and_travel(
        self,
        offsets: torch.Tensor,
        exponents: tuple[float, float] = (BLADE_EXPONENT, TOWER_EXPONENT),
        dial: tuple[float, ...] | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Lifetime cost less that of the published controller, and mean pitch travel of the blades [rad/s].

        Parameters
        ----------
        offsets : torch.Tensor, shape (3, n)
            [rad].
        exponents : (float, float)
            Of blades and tower. With others than those of the metrics, loads are scaled to agree with them for the
            recorded policy: a smaller exponent spreads the gradient over more cycles.
        dial : tuple of float, optional
            Factors on the parts of the cost.
        """
        now = self.metrics(offsets, exponents)
        travel = now["pitch_duty_cycle"] * self._limits.full_rate
        if exponents != (BLADE_EXPONENT, TOWER_EXPONENT):
            scale = self._scales(exponents)
            now = {name: value * scale.get(name, 1.0) for name, value in now.items()}
        total = torch.zeros(())
        for name, value in now.items():
            before = self._baseline[name]
            size = 1.0 if name == "pitch_duty_cycle" else before
            part = FLOATING_COST_WEIGHTS[name] * (value - before) / size
            total = total + (part if dial is None else dial[DIAL_NAMES.index(_DIALED[name])] * part)
        return total, travel

    def _scales(self, exponents: tuple[float, float]) -> dict[str, float]:
        """Loads of the recorded policy with the exponents of the metrics over those with others."""
        if getattr(self, "_scaled_for", None) != exponents:
            with torch.no_grad():
                true = self.metrics(self._acted, (BLADE_EXPONENT, TOWER_EXPONENT))
                other = self.metrics(self._acted, exponents)
            loads = [name for name in true if name.endswith("_del")]
            self._scaled_for, self._scale = exponents, {name: float(true[name] / other[name]) for name in loads}
        return self._scale


def tensor(values: NDArray[np.float64]) -> torch.Tensor:
    """Array in single precision."""
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
