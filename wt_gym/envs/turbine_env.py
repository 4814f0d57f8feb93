"""The Gymnasium environment."""

from __future__ import annotations

import copy
import inspect
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from wt_gym.control import ActionMap, AgentSetpoint, Demand, OperatingPoint
from wt_gym.control.closed_loop import advance_controlled
from wt_gym.control.controllers import (
    AboveRated,
    FadeParameters,
    WithLidar,
    checked_demand,
    lidar_of,
    make_controller,
)
from wt_gym.control.controllers.names import ALIASES, BASELINE
from wt_gym.control.residual import ResidualPitch
from wt_gym.control.starting_point import starting_point
from wt_gym.deprecated import renamed_attribute
from wt_gym.envs import rewards
from wt_gym.envs.arguments import check_flag, check_mapping, check_names, check_number, did_you_mean, shown
from wt_gym.envs.costs import Costs
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.observable import DEFAULT_GROUPS, RESIDUAL_GROUPS
from wt_gym.envs.observations import Observer
from wt_gym.envs.readers import ObservationContext
from wt_gym.envs.running_start import RunningStart, Start, steady_start
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS, TRANSIENTS, WindSampler
from wt_gym.errors import ControllerError, SimulationError
from wt_gym.simulation import Simulator
from wt_gym.simulation.drivetrain.drives import available_torque, pitch_delay
from wt_gym.simulation.drivetrain.faults import DriveFault, SensorBias, checked_faults
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.turbines.damper import GENERATORS, with_generator
from wt_gym.turbines.site import with_site

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from gymnasium.envs.registration import EnvSpec

    from wt_gym.control import Lidar
    from wt_gym.control.controllers import Controller, Readings
    from wt_gym.envs.rewards.compose import Part
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.simulation import Fidelity, Signals, SimulatorState
    from wt_gym.wind import Inflow

__all__ = ["EnvSnapshot", "WindTurbineEnv", "env_arguments", "turbine_env_of"]

_RESET_OPTIONS = (
    "wind_speed", "wind_seed", "time_offset", "inflow", "rotor_speed", "pitch", "azimuth", "yaw", "generator_torque",
    "faults",
)  # fmt: skip

STARTS = ("running", "steady")
"""What state an episode in turbulence begins with."""

# What an episode remembers beside the simulator, the sensors and the random numbers
_SNAPSHOT = (
    "signals", "demand", "base", "setpoint", "controller", "reward_terms", "_action", "_observation", "_saturated",
    "_steps", "_running", "_failed", "_twin_terms", "_residual", "_faults",
)  # fmt: skip


@dataclass(frozen=True)
class EnvSnapshot:
    """An environment in the middle or at the end of an episode, see `WindTurbineEnv.snapshot`."""

    simulator: SimulatorState | None
    kept: dict
    sensors: dict
    wind: EpisodeWind
    random: dict
    twin: EnvSnapshot | None
    pictured: tuple | None


class WindTurbineEnv(gym.Env):
    """A wind turbine in the wind, to be controlled by blade pitch, nacelle yaw and generator torque.

    Behind every step runs a full aeroelastic simulation: flexible blades and tower in a multibody system, loaded by an
    unsteady vortex lattice with a free wake. The task is to make power and spare the structure.

    ## Action space

    ``Box(-1, 1, (n,), float32)``, held over a control step of ``control_dt``. What it means is chosen by three
    arguments; components come in the order pitch, yaw, torque.

    ``action_mode``: ``"rate"`` (default) moves the demands on the drives; ``"absolute"`` gives the demands, pitch over
    the operating points of the winds that are drawn and 5 degrees beyond them on both sides, torque from 0 to the
    largest; ``"residual"`` moves offsets from the demands of a ``controller`` that runs beneath at the step of
    the simulator: the zero action is the controller. Numbers for the NREL 5-MW:

    | component      | rate, at -1 and +1 | absolute (wind 6 to 18 m/s) | residual: rate, limit of the offset |
    |----------------|--------------------|-----------------------------|-------------------------------------|
    | pitch          | -8, 8 deg/s        | 0, 20 deg                   | 1.5 deg/s, 4 deg                    |
    | pitch tilt, yaw| -1.5, 1.5 deg/s    | -4, 4 deg                   | 1.5 deg/s, 4 deg                    |
    | yaw            | -0.3, 0.3 deg/s    | -0.3, 0.3 deg/s             | 0.3 deg/s, none                     |
    | torque (HSS)   | -15, 15 kN m/s     | 0, 47.4 kN m                | 2.2 kN m/s, 4.4 kN m                |

    ``pitch``: ``"collective"`` one component for all blades; ``"individual"`` one a blade, blade 1 first;
    ``"fixed-frame"`` mean, tilt and yaw in the frame that does not turn (`wt_gym.control.coleman`), of which every
    blade gets its share at every step of the simulator; ``"cyclic"``, residual only, tilt and yaw without the mean,
    which stays with the controller. ``action_components`` leaves components out: pitch and torque
    are then the controller's, yaw rests unless the controller yaws. ``action_spans`` changes rates and limits. Residual
    offsets are narrow enough for a random policy to survive, and residual torque does not lift the power beyond 1.03
    times rated.

    Positive pitch feathers; positive yaw is counter-clockwise seen from above, whichever way the rotor turns
    (``turbine.rotation``); tilt and yaw of the pitch are those of the azimuth in the sense of rotation. A turbine
    without yaw drive (greatest yaw rate 0) has no yaw component, one whose generator is a damper no torque component.
    Within a control step demands move evenly, and stop at the limits of the turbine; drives, with their own dynamics
    and greatest rates, follow the demands. An action that is not finite, of another shape or beyond [-1, 1] by more
    than rounding raises `wt_gym.errors.ActionError`, leaves the state as it was, and the episode can go on.
    ``env.unwrapped.layout.action.table()`` has the numbers of every choice.

    ## Observation space

    ``Box(float32)``, ``(value - offset) / scale`` of each measured quantity, with scales that are about the standard
    deviation under the baseline controller in turbulence; a sensor at the end of its range stays there, and is then
    named in ``info["saturated"]``. ``observation`` names groups and single channels. Numbers for the NREL 5-MW:

    | group           | quantity                                   | offset | scale  | min    | max    | unit    |
    |-----------------|--------------------------------------------|--------|--------|--------|--------|---------|
    | rotor           | rotor speed                                | 12.1   | 1.21   | 0      | 24.2   | rpm     |
    | rotor           | generator speed                            | 1173.7 | 117.4  | 0      | 2347   | rpm     |
    | power           | electrical power                           | 4      | 1.25   | -5     | 10     | MW      |
    | power           | generator torque                           | 34.8   | 10.9   | -47.4  | 94.8   | kN m    |
    | power           | generator torque demand                    | 34.8   | 10.9   | 0      | 47.4   | kN m    |
    | pitch           | pitch, mean or of 3 blades                 | 5.7    | 5.7    | -5.7   | 95.7   | deg     |
    | pitch           | pitch rate over the step                   | 0      | 1.2    | -16    | 16     | deg/s   |
    | pitch           | pitch demand                               | 5.7    | 5.7    | 0      | 90     | deg     |
    | wind            | nacelle anemometer (1 s filter)            | 12     | 4      | 0      | 60     | m/s     |
    | wind            | yaw error, wind vane (5 s filter)          | 0      | 5.7    | -180   | 180    | deg     |
    | wind_estimate   | rotor-effective wind from speed and torque | 12     | 4      | 0      | 60     | m/s     |
    | blades          | tip deflection out of plane, 3 blades      | 3.26   | 1.23   | -61.5  | 61.5   | m       |
    | blades          | tip deflection in plane, 3 blades          | -0.62  | 0.46   | -61.5  | 61.5   | m       |
    | blades          | flapwise root moment, 3 blades             | 6.2    | 2.2    | -124   | 124    | MN m    |
    | blades          | edgewise root moment, 3 blades             | 0      | 2.7    | -71    | 71     | MN m    |
    | fixed_frame     | tip deflection out of plane: mean          | 3.26   | 1.23   | -123   | 123    | m       |
    | fixed_frame     | the same: tilt, yaw                        | 0.49   | 0.46   | -123   | 123    | m       |
    | fixed_frame     | flapwise root moment: mean                 | 6.2    | 1.9    | -247   | 247    | MN m    |
    | fixed_frame     | the same: tilt, yaw                        | 0.87   | 0.93   | -247   | 247    | MN m    |
    | tower           | tower-top displacement fore-aft            | 0.28   | 0.081  | -9     | 9      | m       |
    | tower           | the same, side-side                        | -0.045 | 0.0225 | -9     | 9      | m       |
    | tower           | nacelle acceleration fore-aft              | 0      | 0.11   | -20    | 20     | m/s^2   |
    | tower           | the same, side-side                        | 0      | 0.065  | -20    | 20     | m/s^2   |
    | azimuth         | sine and cosine of the azimuth             | 0      | 0.7    | -1     | 1      | -       |
    | controller      | pitch and torque demanded by it            | as above                                     |
    | offsets         | residual pitch coordinates, torque         | 0      | half the limit                      |
    | lidar           | wind 0.5, 1 and 1.5 diameters ahead        | 12     | 4      | 0      | 60     | m/s     |
    | previous_action | last action                                | 0      | 1      | -1     | 1      | -       |

    By default residual actions see rotor, power, pitch, wind, fixed_frame, tower, controller and offsets, others rotor,
    power, pitch, wind, blades, tower, azimuth and previous_action. Single channels beyond the groups: the moments of
    the tower base, mean, tilt and yaw of any signal of the blades, for example ``"root_edge_moment_yaw"``, and
    ``"residual_share"`` and ``"residual_mean"`` where residual pitch fades or is washed out.
    ``sensor_noise``, ``sensor_delay`` and ``history`` make readings worse or more.
    ``env.unwrapped.layout`` holds names, units, scales and ranges for every turbine and choice of arguments;
    `wt_gym.envs.layout.ObservationLayout.value` reads a quantity.

    ## Reward

    The sum of rates times ``control_dt``, so an episode's return is an integral over time that does not depend on the
    control step; each term of a step stands in ``info["reward_terms"]``. Penalties are ``-w x^2 / (1 + x^2)``, hence
    bounded. With P the electrical power, R the rated one, E the kinetic energy of the rotor up to rated speed, M the
    root moment of the Betz thrust at rated wind (`reference_loads.reference_flap_moment`) and T that of the
    tower base; moments are those behind a high-pass filter of 10 s:

    | term                    | weight | rate [1/s]                                                            |
    |-------------------------|--------|-----------------------------------------------------------------------|
    | power                   | 1      | w (1 + (min(P, R) + dE/dt - P_available) / R), from -w to 2 w         |
    | blade_fatigue           | 1.5    | x = flap moments / (0.35 M), blade by blade and as tilt and yaw       |
    | tower_fore_aft_fatigue  | 1      | x = fore-aft moment / (0.33 T)                                        |
    | tower_side_side_fatigue | 1      | x = side-side moment / (0.08 T)                                       |
    | actuator_use            | 0.1    | -w mean of abs(rate)/greatest rate of pitch, yaw and torque           |
    | overspeed               | 0.4    | x = (rotor speed / rated - 1.02) / 0.1 where positive                 |

    P_available is what the turbine can make of the rotor-effective wind of the episode, up to R: a turbine that takes
    what there is and feels no load earns 1 per second in any wind. Further terms, ``tip_deflection``, ``tower_load``
    and ``damage`` (rainflow counting), have weight 0. See `wt_gym.envs.rewards` and ``docs/rewards.md``.

    A terminated episode gets the further term ``termination`` = ``-termination_penalty`` (default 120). An early end
    never pays: the worst operation costs 5 per second, which is 100 altogether at a discount of 0.99 per 0.2 s, less
    than the penalty; and without a discount an idling turbine, feathered and without torque, earns no less than about
    0 per second (0 above rated wind, more below) once its rotor has stopped turning fast, which costs 7.

    ## Starting state

    In turbulence the turbine runs, by default (``start="running"``): rotor speed, pitch, generator torque, azimuth and
    the swinging tower are those of an instant of a record of the turbine under its base controller, or the baseline
    where there is none, in turbulence of the same kind; the base controller has read what it read before that instant.
    The instant is one after winds like those before the start (`wt_gym.envs.running_start`). Records are made once for
    a turbine, a controller and a wind speed and kept on disk. With ``start="steady"``, in steady winds, gusts and
    winds below cut-in and above cut-out, it starts near its steady operating point
    (`wt_gym.control.operating_point.operating_point`): rotor speed, pitch and generator torque of the mean wind speed,
    azimuth drawn uniformly, tower at rest. So it does where an option fixes rotor speed, pitch or torque. Structure and
    wake are as ``Simulator.reset`` leaves them, the yaw angle is 0. At yaw angle 0 the nacelle faces a wind that blows
    along +x. Winds made here have their direction against the nacelle, so that the option ``yaw`` turns the world:
    actions, observations and rewards stay the same. An inflow of your own blows from where it does, and meets the rotor
    with the yaw error that follows from ``yaw``. Extreme winds meet a parked turbine: rotor at rest, blades feathered,
    no torque; it needs a negative ``standstill_limit``, and of the controllers beneath none is for it.

    ``reset(options=...)`` fixes any of ``wind_speed`` [m/s], ``wind_seed``, ``time_offset`` [s], ``rotor_speed``
    [rad/s], ``pitch`` [rad], ``azimuth`` [rad], ``yaw`` [rad] and ``generator_torque`` [N m]. The torque is never more
    than a generator can brake with at the rotor speed (`wt_gym.simulation.drivetrain.drives.available_torque`): none
    at standstill. Two more options hold for the episode: ``inflow``, an Inflow in place of the drawn wind, and
    ``faults``, what breaks in it and when (`wt_gym.simulation.drivetrain.faults`): blades that stick, a generator that
    is lost, a shut-down, sensors that read wrong. Actions, observations and the ends of episodes stay what they are.

    ## Episode end

    Terminated (``info["termination"]`` says why):

    - ``"overspeed"``: rotor speed above ``overspeed_limit`` times rated, at any structural step of the control step;
    - ``"standstill"``: rotor speed below ``standstill_limit`` times rated, the rotor has stalled or was braked;
    - ``"tower_strike"``: a blade tip touched the tower or passed behind it, at or between structural steps;
    - ``"failure"``: the simulation left the range in which it has meaning, or energy came from nothing;
      ``info["failure"]`` holds the message, and the observation is the last good one.

    Truncated: ``episode_length`` is over. Either way the environment can be reset and used on.

    ## Info

    ``time`` [s], ``wind_speed`` (mean) [m/s], ``wind_seed`` (-1 without turbulence), ``generator_power`` [W],
    ``rotor_speed`` [rad/s], ``rotor_speed_max`` [rad/s] and ``tip_clearance_min`` [m] (over all structural steps of the
    control step and all blades), ``reward_terms`` (dict, after a step), ``saturated`` (tuple of channel names), and
    for constrained learning, after a step, ``cost``, the sum of ``costs`` (dict, see `wt_gym.envs.costs`).
    ``env.unwrapped.signals`` has every signal of the simulator.

    ## Arguments

    Parameters
    ----------
    turbine : str, path or Turbine
        Name in the catalogue, a windIO file, an OpenFAST model (.fst), or a turbine.
    generator : {"torque", "damper"}, optional
        A torque that is demanded, or the damper of the turbine, M = c Ω, which takes no demand; default: what the
        turbine has. With the damper there is no torque component, rated rotor speed is that at which it makes the rated
        power (`wt_gym.turbines.damper.with_damper`), and of a controller beneath only pitch and yaw act.
    site : mapping, optional
        Numbers of the site that replace those of the turbine: ``air_density`` [kg/m^3], ``cut_in``, ``cut_out`` [m/s],
        ``iec_class``, ``turbulence_class``, and ``controller_air_density``, the density that the controller is designed
        for, by default that of the turbine (`wt_gym.turbines.site.with_site`).
    inflow : {"steady", "turbulent", "gusts", "extreme", "extreme-turbulent"}, Inflow, path, mapping, sequence, callable
        Steady sheared wind, IEC turbulence, gusts of IEC 61400-1 (see ``gusts``), the IEC extreme wind model
        (EWM) steady or turbulent, or inflows of one's own: one, several to draw from, or a function of a random
        generator. Files of wind are paths, or mappings with options (``docs/wind.md``): TurbSim's .bts, series in
        .csv, .wnd and .hh, boxes of HAWC2 and hipersim. The time in a box at which an episode begins is drawn, in a
        record that is not periodic so that the episode is over before the record is; a series is met from its
        beginning.
    wind_speed : float or (float, float)
        Mean wind speed at hub height, or the range it is drawn from at each reset [m/s]; extreme winds have that of the
        turbine's class.
    shear_exponent : float, optional
        Of the power-law profile, before gusts too; default 0.2, and 0.11 in extreme winds.
    roughness_length : float, optional
        Of the ground [m]: the profile is then logarithmic instead of a power law.
    reference_height : float, optional
        Height at which ``wind_speed`` holds instead of hub height [m], for example the gradient height of a boundary
        layer; the speed that the profile has at the hub is that of operating points and ``info``.
    turbulence_class : {"A+", "A", "B", "C"}, optional
        Default: that of the turbine.
    wind_seeds : sequence of int
        Turbulence seeds to draw from, by default `TRAINING_WIND_SEEDS`; `EVALUATION_WIND_SEEDS` are disjoint from them.
    wind_direction : float or (float, float)
        Of the wind at the start against the nacelle, or the range it is drawn from [rad].
    wind_wander : (float, float), optional
        Standard deviation [rad] and time constant [s], at least 1 s, with which the direction wanders from then on; it
        is drawn for 1200 s, after which the direction stays.
    turbulence_model : {"NTM", "ETM"}
        Normal or extreme turbulence of IEC 61400-1, for ``inflow="turbulent"``.
    turbulence : {"kaimal", "mann"}
        Spectra of turbulent winds: Kaimal's, or Mann's uniform shear model (``docs/wind.md``).
    gusts : sequence of {"EOG", "EDC", "ECD", "EWS", "ETM"}
        What ``inflow="gusts"`` draws: extreme operating gust, extreme direction change, coherent gust with direction
        change, wind shear (vertical or horizontal, together twice as often as each of the others), and turbulence of
        the extreme turbulence model. Default: all but ETM.
    return_period : {50, 1}
        Of extreme winds, in years.
    fidelity : str or Fidelity
        Of the simulator: ``"training"``, ``"engineering"``, either with ``"-torsion"`` behind it for blades that twist,
        ``"reference"`` or one's own.
    control_dt : float
        Control step [s], a multiple of the simulator's step.
    episode_length : float or None
        Time after which an episode is truncated [s]; None: never, for a time limit from outside. Tasks have such a
        limit: their episodes are made longer by ``max_episode_steps`` of `gymnasium.make`.
    action_mode : {"rate", "absolute", "residual"}
    pitch : {"collective", "individual", "fixed-frame", "cyclic"}
    action_components : sequence of {"pitch", "yaw", "torque"}, optional
        By default all that the turbine has.
    action_spans : mapping, optional
        Other rates and limits, see `wt_gym.control.ActionMap`.
    residual_fade : bool, float or FadeParameters
        Let residual pitch act only above rated wind, as additions to industrial controllers do
        (`wt_gym.control.controllers.fading.AboveRated`): blades at fine pitch stay where they make the most power.
        The share that acts can be observed as "residual_share". Other modes have none to fade.
    residual_washout : float, optional
        Time constant of a high-pass filter on the mean of the blades' residual pitch [s]: offsets of all blades that
        last are left to the controller beneath, see `wt_gym.control.residual`. What acts can be observed as
        "residual_mean". It has no effect on tilt and yaw alone, or in other modes.
    controller : str, Controller or callable
        What runs beneath residual actions, or decides on components left out: a name for
        `wt_gym.control.controllers.make_controller` (``"path/file.py:Class"`` among them), a controller, or a function
        that makes one for a turbine.
    reward : mapping, str, callable, RewardTerm or iterable of them, optional
        Weights by name; or the terms alone: names, functions that give a rate, terms of one's own. See
        `wt_gym.envs.rewards.compose`.
    relative_reward : bool
        Take off what the controller alone earns in the same wind: a second turbine runs beside the first, at twice the
        cost.
    vector_reward : bool
        Give the terms as an array instead of their sum, as multi-objective libraries take it; named in
        ``reward_names``, with a ``reward_space``.
    termination_penalty : float
        Subtracted from the reward when an episode is terminated.
    overspeed_limit : float
        Highest rotor speed over rated rotor speed.
    standstill_limit : float, optional
        Lowest rotor speed over rated rotor speed; 0 allows a stop but no turning backwards, a negative one that too. By
        default 0.2; -1 with a damper, which lets the rotor turn slowly.
    observation : sequence of str, optional
        Groups and channels to observe.
    sensor_noise : float
        Level of white measurement noise; 0 none, 1 typical instruments.
    sensor_delay : float
        Time by which readings are late [s], a multiple of ``control_dt``, at most 1000 of them.
    history : int
        Readings in an observation, at most 1000: the present one, then those of the steps before.
    lidar : Lidar, optional
        Ranges and cone of the group "lidar"; by default those of the lidar that the controller beneath reads, if it
        does, else `wt_gym.control.Lidar.for_rotor`.
    render_mode : {"rgb_array"}, optional
        Picture of turbine and wake with the recent course of the key signals.
    start : {"running", "steady"}
        What an episode in turbulence begins with, see "Starting state".

    Attributes
    ----------
    layout : EnvLayout
        Everything that is to be known of observation and action.
    observation_names, observation_units : numpy.ndarray of str, shape (n_obs,)
        Of the components of an observation, and of what they stand for in ``layout.observation.value``.
    action_names, action_units : numpy.ndarray of str, shape (n_act,)
        Of the components of an action, and of what they stand for at -1 and +1.

    Raises
    ------
    TypeError
        If there is no such argument; the message names the one that it resembles.
    ValueError, wt_gym.errors.InflowError, wt_gym.errors.TurbineDefinitionError
        If an argument has no meaning.

    Notes
    -----
    Compiled kernels are cached on disk; the first episode ever compiles them. Make one environment before starting
    worker processes, and start those by spawn or forkserver, not fork.

    ## Version history

    v0: first version.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012 - Gymnasium's attribute

    observation_space: spaces.Box
    action_space: spaces.Box

    def __init__(
        self,
        turbine: str | Turbine = "nrel_5mw",
        inflow: str | os.PathLike | Inflow | Sequence[Inflow | str | os.PathLike] | Callable[..., Inflow] = "steady",
        wind_speed: float | tuple[float, float] = (6.0, 18.0),
        shear_exponent: float | None = None,
        turbulence_class: str | None = None,
        wind_seeds: Sequence[int] = TRAINING_WIND_SEEDS,
        wind_direction: float | tuple[float, float] = 0.0,
        wind_wander: tuple[float, float] | None = None,
        turbulence_model: str = "NTM",
        return_period: int = 50,
        fidelity: str | Fidelity = "training",
        control_dt: float = 0.2,
        episode_length: float | None = 120.0,
        action_mode: str = "rate",
        pitch: str = "collective",
        action_components: Sequence[str] | None = None,
        action_spans: Mapping[str, float] | None = None,
        residual_fade: bool | float | FadeParameters = False,
        residual_washout: float | None = None,
        controller: str | Controller | Callable = "discon",
        reward: Mapping[str, float] | Part | Iterable[Part] | None = None,
        relative_reward: bool = False,
        vector_reward: bool = False,
        termination_penalty: float = 120.0,
        overspeed_limit: float = 1.25,
        standstill_limit: float | None = None,
        observation: Sequence[str] | None = None,
        sensor_noise: float = 0.0,
        sensor_delay: float = 0.0,
        history: int = 1,
        lidar: Lidar | None = None,
        render_mode: str | None = None,
        generator: str | None = None,
        roughness_length: float | None = None,
        reference_height: float | None = None,
        turbulence: str = "kaimal",
        gusts: Sequence[str] = TRANSIENTS,
        site: Mapping[str, Any] | None = None,
        start: str = "running",
        **unknown: Any,
    ):
        if unknown:
            raise _unknown_argument(next(iter(unknown)))
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be one of {self.metadata['render_modes']} or None, got {render_mode!r}")
        if start not in STARTS:
            raise ValueError(f"start must be one of {STARTS}, got {shown(start)}")
        if not check_number("overspeed_limit", overspeed_limit) > 1.0:
            raise ValueError(f"overspeed_limit must be above 1, got {overspeed_limit!r}")
        if check_number("termination_penalty", termination_penalty) < 0.0:
            raise ValueError(f"termination_penalty must be finite and not negative, got {termination_penalty!r}")
        if not (isinstance(controller, str) or callable(controller) or hasattr(controller, "start")):
            raise ValueError(f"controller must be a name, a Controller or a function, got {shown(controller)}")
        control_dt = check_number("control_dt", control_dt, "s")
        sensor_noise = check_number("sensor_noise", sensor_noise)
        sensor_delay = check_number("sensor_delay", sensor_delay, "s")
        history = cast(int, check_number("history", history))
        relative_reward = check_flag("relative_reward", relative_reward)
        vector_reward = check_flag("vector_reward", vector_reward)
        if residual_washout is not None:
            residual_washout = check_number("residual_washout", residual_washout, "s")
        if action_components is not None:
            action_components = check_names("action_components", action_components)
        if action_spans is not None:
            action_spans = check_mapping("action_spans", action_spans)
        turbine = with_site(turbine if isinstance(turbine, Turbine) else load_turbine(turbine), site)
        if generator is not None and generator not in GENERATORS:
            raise ValueError(f"generator must be one of {GENERATORS} or None, got {generator!r}")
        self.turbine, _ = with_generator(turbine, generator)
        if standstill_limit is None:
            standstill_limit = 0.2 if self.turbine.drivetrain.takes_torque else -1.0
        if not -1.0 <= check_number("standstill_limit", standstill_limit) < 1.0:
            raise ValueError(f"standstill_limit must be at least -1 and below 1, got {standstill_limit!r}")
        self.wind = WindSampler(
            self.turbine, inflow, wind_speed, shear_exponent, turbulence_class, wind_seeds, wind_direction, wind_wander,
            turbulence_model, return_period, roughness_length, reference_height, turbulence, gusts,
        )  # fmt: skip
        if self.wind.parks and standstill_limit >= 0.0:
            raise ValueError(
                f"inflow={inflow!r} starts a parked rotor, which may turn slowly to either side: standstill_limit must "
                f"be negative, got {standstill_limit!r}"
            )
        self.reward_terms = rewards.compose(reward)
        self.termination_penalty = float(termination_penalty)
        self.overspeed_limit, self.standstill_limit = float(overspeed_limit), float(standstill_limit)
        self.control_dt, self.fidelity = float(control_dt), fidelity
        self._inner_dt, self._substeps = self._inner_steps()
        self._max_steps = None
        self.outer_steps: int | None = None  # after which an episode ends from outside, where that is told
        if episode_length is not None:
            episode_length = check_number("episode_length", episode_length, "s")
            self._max_steps = self._steps_in("episode_length", episode_length, least=1)
        delay = pitch_delay(self.turbine.pitch, self._inner_dt)
        action = ActionMap(
            self.turbine, control_dt, action_mode, pitch, action_components, action_spans, self.wind.speeds, delay
        )
        self.controller = None
        if action.needs_controller or controller not in (BASELINE, *ALIASES):  # a copy: no two share its memory
            self.controller = copy.deepcopy(make_controller(controller, self.turbine))
        self._residual = self._make_residual(action, residual_fade, residual_washout)
        if observation is None:
            observation = RESIDUAL_GROUPS if action_mode == "residual" else DEFAULT_GROUPS
        observation = check_names("observation", observation)
        late = self._steps_in("sensor_delay", sensor_delay, least=0)
        lidar = self._lidar(lidar)
        self._observer = Observer(self.turbine, action, observation, sensor_noise, late, history, lidar, self._residual)
        self._costs = Costs(self.turbine, self.control_dt, self.overspeed_limit)
        observer = self._observer
        self.layout = EnvLayout(self.turbine, observer.layout, action, self.control_dt, late, observer.lidar)
        self.action_space = spaces.Box(-1.0, 1.0, (action.size,), np.float32)
        self.observation_space = spaces.Box(self._observer.layout.low, self._observer.layout.high, dtype=np.float32)
        self._vector_reward = bool(vector_reward)
        if vector_reward:
            names = [term.name for term in self.reward_terms]
            self.reward_names = (*names, "termination")
            self.reward_space = spaces.Box(-np.inf, np.inf, (len(self.reward_names),), np.float32)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_dt))}
        # nothing before the first reset, which everything that needs them asks for
        self.simulator, self.signals = cast(Simulator, None), cast("Signals", None)
        self._faults: tuple[DriveFault | SensorBias, ...]
        self._sensor_faults: tuple[SensorBias, ...]
        self._drive_faults: tuple[DriveFault, ...]
        self._faults = self._sensor_faults = self._drive_faults = ()
        self._observation: np.ndarray | None
        self._saturated: tuple[str, ...]
        self._look: tuple[tuple, np.ndarray] | None = None
        self._twin: WindTurbineEnv | None = None
        self._twin_terms: dict[str, float] = {}
        if relative_reward:
            # its winds are those drawn here, so that it has none of its own to choose from
            self._twin = WindTurbineEnv(
                self.turbine, "steady", (self.turbine.cut_in, self.turbine.cut_out), fidelity=fidelity,
                control_dt=control_dt, episode_length=None, action_mode="residual", action_components=("pitch",),
                controller=copy.deepcopy(controller), reward=self.reward_terms, termination_penalty=termination_penalty,
                overspeed_limit=overspeed_limit, standstill_limit=standstill_limit, observation=("rotor",),
                start="steady",
            )  # fmt: skip
        self._starts = self._make_starts(start)
        self._renderer = self._make_renderer()
        self._running = self._failed = self._told_of_limit = False
        self._steps = 0

    def __repr__(self) -> str:
        fidelity = fidelity_of(self.fidelity).name
        return (
            f"<{type(self).__name__}: {self.turbine.name}, {self.wind.label}, {fidelity} fidelity, {self.layout.sizes}>"
        )

    aim = renamed_attribute("aim", "setpoint")  # rename: keep

    @property
    def observation_names(self) -> np.ndarray:
        """Name of every component of an observation."""
        return np.array(self.layout.observation.names)

    @property
    def observation_units(self) -> np.ndarray:
        """Unit of what every component of an observation stands for, "-" for none."""
        return np.array([channel.unit for channel in self.layout.observation.channels])

    @property
    def action_names(self) -> np.ndarray:
        """Name of every component of an action."""
        return np.array(self.layout.action.names)

    @property
    def action_units(self) -> np.ndarray:
        """Unit of what every component of an action stands for."""
        return np.array(self.layout.action.units)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            See "Starting state" in the class documentation.

        Returns
        -------
        observation : numpy.ndarray, float32
        info : dict

        Raises
        ------
        ValueError
            If an option is unknown or no number.
        wt_gym.errors.InflowError
            If a wind is asked for that cannot be had.
        wt_gym.errors.ActionError
            If an option is out of range, for example more torque than there is at the rotor speed.
        wt_gym.errors.SimulationError
            If there is no steady state to start from, for example because the wind bends the blades too far.
        """
        if self._running and self.outer_steps is None and self._steps == _registered_limit(self.spec):
            self.warn_of_limit(self.spec, None)  # whether the limit of the id stands is known only now
        self._running = False
        super().reset(seed=seed)
        if options is not None and not isinstance(options, dict):
            raise ValueError(f"the options of reset must be a dict, got {shown(options)}")
        options = dict(options or {})
        unknown = [name for name in options if name not in _RESET_OPTIONS]
        if unknown:
            raise ValueError(f"reset has no options {unknown}; there are {_RESET_OPTIONS}")
        for name in ("rotor_speed", "pitch", "azimuth", "yaw", "generator_torque"):
            if name in options:
                options[name] = check_number(name, options[name], finite=False)
        wind_options = {name: options[name] for name in ("wind_speed", "wind_seed", "time_offset") if name in options}
        faults = checked_faults(options.get("faults", ()), self.turbine.n_blades)
        yaw = check_number("yaw", options.get("yaw", 0.0), "rad")
        if "inflow" in options:
            self.episode_wind = self.wind.given(options["inflow"], **wind_options)
        else:
            self.episode_wind = self.wind.sample(self.np_random, **wind_options, length=self._longest(), heading=yaw)
        azimuth = self.np_random.uniform(0.0, 2.0 * math.pi)
        start = self._drawn_start(options, yaw, azimuth)
        self._begin(self.episode_wind, start, yaw, faults)
        if self._twin is not None:
            self._twin._begin(self.episode_wind, start, yaw, faults)
        observation, saturated = self._observe()
        if self._renderer is not None:
            self._renderer.reset()
            self._renderer.record(self.signals)
        return observation, self._info(saturated)

    def _drawn_start(self, options: dict[str, Any], yaw: float, azimuth: float) -> Start:
        """Start of the running turbine in the wind of the episode, or a steady one where there is none or one is asked.

        A steady start has the operating point of the wind, or what the options of the reset say.
        """
        given = {name for name in ("rotor_speed", "pitch", "generator_torque") if name in options}
        if self._starts is not None and not given:
            chosen = float(options["azimuth"]) if "azimuth" in options else None
            start = self._starts.draw(self.episode_wind, yaw, self.np_random, chosen)
            if start is not None:
                return start
        point = self._start_point()
        speed, pitch = float(options.get("rotor_speed", point.rotor_speed)), float(options.get("pitch", point.pitch))
        torque = min(point.generator_torque, available_torque(self.turbine.drivetrain, speed))
        torque, azimuth = float(options.get("generator_torque", torque)), float(options.get("azimuth", azimuth))
        return steady_start(speed, pitch, torque, azimuth, self.turbine.n_blades)

    def _make_starts(self, kind: str) -> RunningStart | None:
        """Where episodes get their starts from, None where they are steady."""
        if kind == "steady" or self.wind.parks:
            return None
        controller = make_controller(BASELINE, self.turbine) if self.controller is None else self.controller
        return RunningStart(self.turbine, self.fidelity, controller, self.wind, self.overspeed_limit)

    def _longest(self) -> float | None:
        """Longest time that an episode can last [s], None without a limit."""
        steps = self._max_steps if self._max_steps is not None else self._outer_limit()
        return None if steps is None else steps * self.control_dt

    def _outer_limit(self) -> int | None:
        """Control steps after which something outside ends an episode, None if nothing is known to.

        A `gymnasium.wrappers.TimeLimit` does not tell what it encloses; that of the id is known.
        """
        return _registered_limit(self.spec) if self.outer_steps is None else self.outer_steps

    def warn_of_limit(self, spec: EnvSpec | None, outer_steps: int | None) -> None:
        """Warn where the limit of an id ends episodes before the length that they were given.

        Parameters
        ----------
        spec : EnvSpec or None
            What the environment was made of.
        outer_steps : int or None
            Control steps that episodes are known to end after from outside; None: the limit of the id may stand.
        """
        limit, wanted = _registered_limit(spec), self._max_steps
        if spec is None or limit is None or wanted is None or outer_steps not in (None, limit) or wanted <= limit:
            return
        if self._told_of_limit:
            return
        self._told_of_limit = True
        gym.logger.warn(
            f"the limit of {spec.id} ends episodes after {limit} steps, {limit * self.control_dt:g} s, before the "
            f"episode_length of {wanted * self.control_dt:g} s: make it with max_episode_steps={wanted} instead"
        )

    def _start_point(self) -> OperatingPoint:
        """Operating point of the episode's wind, or a rotor at rest with feathered blades."""
        if self.wind.parks:
            return OperatingPoint(0.0, min(self.turbine.pitch.max_pitch, 0.5 * math.pi), 0.0)
        return starting_point(self.turbine, self.episode_wind.inflow)

    def _begin(self, wind: EpisodeWind, start: Start, yaw: float, faults) -> None:
        """Start simulator, controller, sensors and reward in a wind."""
        self.episode_wind = wind
        self._place_simulator()
        self._take_faults(faults)
        self.signals = self.simulator.reset(
            rotor_speed=start.rotor_speed, pitch=start.pitch, azimuth=start.azimuth, yaw=yaw,
            generator_torque=start.generator_torque, tower_top=start.tower_top, wake_thrust=start.wake_thrust,
            motion=start.motion,
        )  # fmt: skip
        self.demand = self.base = Demand(start.pitch.copy(), 0.0, start.generator_torque)
        self.setpoint = self.layout.action.start(self.demand)
        if self.controller is not None:
            start.start(self.controller, self._read_by(self.controller, self._measured(self.signals)), self.demand)
        if self._residual is not None:
            pitch = start.pitch[0] + float((start.pitch - start.pitch[0]).mean())  # exactly that of equal blades
            self._residual.start(pitch, start.rotor_speed, self._inner_dt)
        self._action = np.zeros(self.layout.action.size)
        self._steps, self._running, self._failed = 0, True, False
        self._observer.reset(self._situation())
        self._observation, self._saturated = None, ()
        rewards.reset(self.reward_terms, self.turbine, self.signals, start.averaged(self.signals))

    def step(self, action):
        """Advance by one control step.

        Parameters
        ----------
        action : array_like, shape (n_act,)

        Returns
        -------
        observation : numpy.ndarray, float32
        reward : float
            With ``vector_reward`` an array, float32, of the terms and "termination", named in ``reward_names``.
        terminated, truncated : bool
        info : dict

        Raises
        ------
        wt_gym.errors.ActionError
            If the action is refused; the state is unchanged.
        wt_gym.errors.ControllerError
            If the controller beneath gives a demand without meaning; the episode is over.
        gymnasium.error.ResetNeeded
            If no episode is running.
        """
        if not self._running:
            raise ResetNeeded("the episode is over, or none was started: call reset() before step()")
        values = self.layout.action.validate(action)
        setpoint, before = self.layout.action.decode(values, self.setpoint), self.signals
        try:
            after = self._advance(setpoint)
            self._check_finite(after)
        except SimulationError as error:
            return self._fail(error)
        except ControllerError:
            self._running = False  # a part of the step may have been simulated
            raise
        self.signals, self.setpoint, self._action = after, setpoint, values
        self._steps += 1
        self._observer.advance(self._measured(after), self.control_dt)
        if self._renderer is not None:
            self._renderer.record(after)

        inflow = self.episode_wind.inflow
        transition = rewards.Transition(self.turbine, before, after, self.control_dt, inflow=inflow, action=values)
        reward, terms = rewards.total(self.reward_terms, transition)
        ending = self._ending()
        if ending is not None:
            reward, terms = self._punish(reward, terms)
        reward, terms = self._compared(reward, terms)
        observation, saturated = self._observe()
        truncated = ending is None and self._max_steps is not None and self._steps >= self._max_steps
        self._running = ending is None and not truncated
        costs = self._costs.of(after)
        info = self._info(saturated) | {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        if ending is not None:
            info["termination"] = ending
        return observation, self._returned(reward, terms), ending is not None, truncated, info

    def _advance(self, setpoint: AgentSetpoint) -> Signals:
        """Simulate a control step, in which the demand moves to the aim at every step of the simulator."""
        start, n, controller, demand = self.setpoint, self._substeps, self.controller, self.layout.action.demand
        turn, rise = setpoint.pitch - start.pitch, setpoint.generator_torque - start.generator_torque

        def demand_at(k: int, signals: Signals) -> Demand:
            part, signals = k / n, self._measured(signals)
            if controller is not None:
                base = controller.step(self._read_by(controller, signals), self._inner_dt)
                self.base = checked_demand(base, controller, self.turbine.n_blades)
            pitch = start.pitch + part * turn
            if self._residual is not None:
                pitch = self._residual.acting(pitch, self.base.pitch, signals["rotor_speed"], self._inner_dt)
            present = AgentSetpoint(pitch, setpoint.yaw_rate, start.generator_torque + part * rise)
            self.demand = demand(present, self.base, signals["azimuth"], signals["rotor_speed"])
            return self.demand

        return advance_controlled(demand_at, self.simulator, self.signals, self._inner_dt, n)

    def _compared(self, reward, terms) -> tuple[float, dict[str, float]]:
        """Reward and terms less those that the controller alone earns in the same wind."""
        twin = self._twin
        if twin is None:
            return reward, terms
        if twin._running:  # when its episode has ended, what it earned last stands
            *_, info = twin.step(np.zeros(twin.layout.action.size))
            self._twin_terms = {name: v for name, v in info["reward_terms"].items() if name != "termination"}
        other = self._twin_terms
        return reward - sum(other.values()), {name: value - other.get(name, 0.0) for name, value in terms.items()}

    def _returned(self, reward, terms):
        """What `step` returns as reward."""
        if not self._vector_reward:
            return reward
        return np.array([terms.get(name, 0.0) for name in self.reward_names], dtype=np.float32)

    # ---- snapshots ----

    def snapshot(self) -> EnvSnapshot:
        """All from which the episode continues bit for bit: simulator, controller, filters, reward, random state.

        For planning: take one, try actions, `restore` it. An episode that is over is kept as such: after restoring it
        `step` asks for a reset, and `render` shows its last instant. With a ``render_mode`` the course of the signals
        in the picture is kept too.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If no episode was started.
        """
        if self.simulator is None or self.signals is None:
            raise ResetNeeded("there is nothing to take a snapshot of: call reset() first")
        kept = {name: self.__dict__[name] for name in _SNAPSHOT}
        return EnvSnapshot(
            None if self._failed else self.simulator.state(),
            copy.deepcopy(kept),
            self._observer.memory(),
            self.episode_wind,
            copy.deepcopy(cast(dict, self.np_random.bit_generator.state)),
            None if self._twin is None else self._twin.snapshot(),
            None if self._renderer is None else self._renderer.memory(),
        )

    def restore(self, snapshot: EnvSnapshot) -> np.ndarray:
        """Continue from a snapshot of this environment or of one made with the same arguments.

        Returns
        -------
        observation : numpy.ndarray, float32
            That of the snapshot; with sensor noise it is drawn anew.

        Raises
        ------
        wt_gym.errors.SimulationError
            If the snapshot belongs to another turbine or fidelity.
        """
        self.episode_wind = snapshot.wind
        self._place_simulator()
        self._take_faults(snapshot.kept["_faults"])
        if snapshot.simulator is not None:
            self.simulator.restore(snapshot.simulator)
        self.__dict__.update(copy.deepcopy(snapshot.kept))
        self._observer.recall(snapshot.sensors)
        self.np_random.bit_generator.state = copy.deepcopy(snapshot.random)
        if self._twin is not None:
            self._twin.restore(cast(EnvSnapshot, snapshot.twin))
        if self._renderer is not None:  # a snapshot of an environment without pictures holds the present signals only
            self._renderer.recall(snapshot.pictured or ())
            if not snapshot.pictured:
                self._renderer.record(self.signals)
        return cast(np.ndarray, None if self._observation is None else self._observation.copy())  # a twin has none

    def render(self):
        """Return a picture of the turbine and its wake, uint8 array of shape (height, width, 3), or None.

        Of a simulation that failed it shows what was drawn last.
        """
        if self._renderer is None:
            gym.logger.warn("render() was called without a render_mode; make the environment with 'rgb_array'")
            return None
        if self.signals is None:
            raise ResetNeeded("render() needs a started episode: call reset() first")
        return self._renderer.draw(None if self._failed else self.simulator.geometry())

    def close(self) -> None:
        """Release the simulator and the renderer."""
        self.simulator, self._renderer, self._running = cast(Simulator, None), None, False

    def _make_renderer(self):
        if self.render_mode is None:
            return None
        from wt_gym.envs.rendering import Renderer  # matplotlib takes half a second to import

        return Renderer(self.turbine)

    def _make_residual(self, action: ActionMap, fade, washout) -> ResidualPitch | None:
        """What residual pitch passes on its way to the blades, if there is such a pitch and anything to pass."""
        try:
            above = AboveRated.of_turbine(self.turbine, fade)
        except ValueError as error:
            raise ValueError(f"residual_{error}") from error
        residual = ResidualPitch(above, washout, action.n_mean)
        has_pitch = action.mode == "residual" and "pitch" in action.components
        return residual if has_pitch and (residual.fades or residual.washes) else None

    def _inner_steps(self) -> tuple[float, int]:
        """Step of the simulator [s] and how many make a control step."""
        step = fidelity_of(self.fidelity).step_for(self.turbine.drivetrain.rated_rotor_speed)
        count = round(self.control_dt / step)
        if count < 1 or abs(count * step - self.control_dt) > 1e-6 * step:
            raise ValueError(
                f"control_dt must be a multiple of the simulator's aerodynamic step of {step:.6g} s, "
                f"got {self.control_dt!r} s"
            )
        return step, count

    def _steps_in(self, name, time, least) -> int:
        """Control steps in a time [s]."""
        count = round(time / self.control_dt)
        if not (count >= least and math.isclose(count * self.control_dt, time, rel_tol=1e-9, abs_tol=1e-12)):
            raise ValueError(
                f"{name} must be a multiple of control_dt = {self.control_dt} s, at least {least} of them, got {time!r}"
            )
        return count

    def _place_simulator(self) -> None:
        """Put the simulator into the wind of the episode, at which the lidar has not looked yet."""
        self._look = None
        if cast("Simulator | None", self.simulator) is None:
            self.simulator = Simulator(self.turbine, inflow=self.episode_wind.inflow, fidelity=self.fidelity)
            self._drive_faults = ()
        else:
            self.simulator.inflow = self.episode_wind.inflow

    def _take_faults(self, faults) -> None:
        """Let drives and sensors have these faults and no others."""
        self._faults = faults
        self._sensor_faults = tuple(fault for fault in faults if isinstance(fault, SensorBias))
        drive_faults = tuple(fault for fault in faults if not isinstance(fault, SensorBias))
        if drive_faults != self._drive_faults:
            self.simulator.faults = self._drive_faults = drive_faults

    def _measured(self, signals: Signals) -> Signals:
        """Signals as the sensors read them."""
        for fault in self._sensor_faults:
            signals = fault.read(signals)
        return signals

    def _lidar(self, given: Lidar | None) -> Lidar | None:
        """The lidar of the observation: that of the controller beneath, if it has one."""
        beneath = None if self.controller is None else lidar_of(self.controller)
        if given is not None and beneath is not None and given != beneath:
            raise ValueError(
                f"the controller beneath reads {beneath}; lidar must be the same or None, got {shown(given)}"
            )
        return given or beneath

    def _read_by(self, controller: Controller, signals: Signals) -> Readings:
        """What a controller reads: measured signals, with those of its lidar if it has one."""
        return signals if lidar_of(controller) is None else WithLidar(signals, self._ahead(signals))

    def _ahead(self, signals: Signals) -> np.ndarray:
        """What the lidar sees at an instant [m/s]: a look is for the observation and for the controller's next step."""
        instant = signals["time"], signals["yaw"]
        if self._look is None or self._look[0] != instant:
            seen = self._observer.lidar.read(self.episode_wind.inflow, *instant, self.turbine.hub_height)
            self._look = instant, seen
        return self._look[1]

    def _situation(self) -> ObservationContext:
        signals = self._measured(self.signals)
        seen = self._ahead(signals) if self._observer.sees_lidar else None
        return ObservationContext(signals, self.demand, self.setpoint, self.base, self._action, seen, self._residual)

    def _observe(self) -> tuple[np.ndarray, tuple[str, ...]]:
        self._observation, self._saturated = self._observer.observe(self._situation(), self.np_random)
        return self._observation.copy(), self._saturated

    def _info(self, saturated: tuple[str, ...]) -> dict[str, Any]:
        return {
            "time": self.signals["time"],
            "wind_speed": float(self.episode_wind.wind_speed),
            "wind_seed": int(self.episode_wind.wind_seed),
            "generator_power": self.signals["generator_power"],
            "rotor_speed": self.signals["rotor_speed"],
            "rotor_speed_max": self.signals["rotor_speed_max"],
            "tip_clearance_min": self._tip_clearance(),
            "saturated": saturated,
        }

    def _ending(self) -> str | None:
        """Why the episode is terminated, if it is."""
        rated = self.turbine.drivetrain.rated_rotor_speed
        if self.signals["rotor_speed_max"] > self.overspeed_limit * rated:
            return "overspeed"
        if self.signals["rotor_speed"] < self.standstill_limit * rated:
            return "standstill"
        return "tower_strike" if self._tip_clearance() <= 0.0 else None

    def _tip_clearance(self) -> float:
        """Smallest signed distance of a tip from the tower during the last step [m]."""
        return min(self.signals["tip_clearance_min"].tolist())

    def _punish(self, reward: float, terms: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Reward and terms of a terminated episode's last step."""
        return reward - self.termination_penalty, {**terms, "termination": -self.termination_penalty}

    def _check_finite(self, signals: Signals) -> None:
        if not math.isfinite(sum(signals.values.tolist())):  # a third of the time of numpy's
            raise SimulationError(f"the simulator returned values that are not finite at {signals['time']!r} s")

    def _fail(self, error: SimulationError):
        """Result of a step that the simulation did not survive: the last good observation and the penalty."""
        self._running, self._failed = False, True
        observation, saturated = cast(np.ndarray, self._observation).copy(), self._saturated
        reward, terms = self._punish(0.0, {term.name: 0.0 for term in self.reward_terms})
        costs = self._costs.of_failure()
        info = self._info(saturated) | {"reward_terms": terms, "cost": sum(costs.values()), "costs": costs}
        info |= {"termination": "failure", "failure": str(error)}
        return observation, self._returned(reward, info["reward_terms"]), True, False, info


def _registered_limit(spec: EnvSpec | None) -> int | None:
    """Control steps after which episodes of an id end, if it has such a limit; one given to `make` is not known."""
    registered = None if spec is None else gym.registry.get(spec.id)
    return None if registered is None else registered.max_episode_steps


def turbine_env_of(env: gym.Env) -> WindTurbineEnv:
    """The environment of the turbine behind any wrappers."""
    return cast("WindTurbineEnv", env.unwrapped)


def env_arguments() -> tuple[str, ...]:
    """Names of the arguments of `WindTurbineEnv`."""
    kinds = inspect.signature(WindTurbineEnv).parameters.items()
    return tuple(name for name, parameter in kinds if parameter.kind is not parameter.VAR_KEYWORD)


def _unknown_argument(name: str) -> TypeError:
    known = env_arguments()
    return TypeError(
        f"the environment has no argument {name!r}{did_you_mean(name, known)} Its arguments are {', '.join(known)}"
    )
