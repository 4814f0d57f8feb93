"""The environment in words: the documentation of its class, and ten lines on one that was made."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import TextWrapper
from typing import TYPE_CHECKING

from wt_gym.envs.operation import OWN
from wt_gym.envs.options import documentation
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.tasks import task_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gymnasium.envs.registration import EnvSpec

    from wt_gym.envs.turbine_env import WindTurbineEnv


HEAD = """A wind turbine in the wind, to be controlled by blade pitch, nacelle yaw and generator torque.

Every step runs an aeroelastic simulation: flexible blades and tower in a multibody system, loaded by an unsteady
vortex lattice with a free wake. The task is to maximize power while limiting structural loads.

## Action space

``Box(-1, 1, (n,), float32)``, held over a control step of ``control_dt``. What it means is chosen by three
arguments; components come in the order pitch, yaw, torque.

``action_mode``: ``"rate"`` (default) moves the demands on the drives; ``"absolute"`` gives the demands, pitch over
the operating points of the winds that are drawn and 5 degrees beyond them on both sides, torque from 0 to the
largest; ``"residual"`` moves offsets from the demands of a base ``controller`` that runs at the step of
the simulator: the zero action is the controller. Numbers for the NREL 5-MW:

| component      | rate, at -1 and +1 | absolute (wind 6 to 18 m/s) | residual: rate, limit of the offset |
|----------------|--------------------|-----------------------------|-------------------------------------|
| pitch          | -8, 8 deg/s        | 0, 20 deg                   | 1.5 deg/s, 4 deg                    |
| pitch tilt, yaw| -1.5, 1.5 deg/s    | -4, 4 deg                   | 1.5 deg/s, 4 deg                    |
| yaw            | -0.3, 0.3 deg/s    | -0.3, 0.3 deg/s             | 0.3 deg/s, none                     |
| torque (HSS)   | -15, 15 kN m/s     | 0, 47.4 kN m                | 2.2 kN m/s, 4.4 kN m                |

``pitch``: ``"collective"`` one component for all blades; ``"individual"`` one a blade, blade 1 first;
``"fixed-frame"`` mean, tilt and yaw in the non-rotating frame (`wt_gym.control.sensors`), distributed to the blades
at every step of the simulator; ``"cyclic"``, residual only, tilt and yaw without the mean,
which stays with the controller. ``action_components`` leaves components out: pitch and torque
are then the controller's, yaw rests unless the controller yaws. ``action_spans`` changes rates and limits. Residual
offsets are narrow enough for a random policy to survive, and residual torque does not lift the power beyond 1.03
times rated.

Positive pitch feathers; positive yaw is counter-clockwise seen from above, whichever way the rotor turns
(``turbine.rotation``); tilt and yaw of the pitch are those of the azimuth in the sense of rotation. A turbine
without yaw drive (greatest yaw rate 0) has no yaw component, one whose generator is a damper no torque component.
Within a control step demands move evenly, and stop at the limits of the turbine; drives, with their own dynamics
and greatest rates, follow the demands. An action that is not finite, of another shape or beyond [-1, 1] by more
than rounding of float32 (`wt_gym.control.actions.ROUNDING`, which is put on the bound exactly) raises
`wt_gym.base.errors.ActionError`, leaves the state unchanged, and the episode can continue.
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
| dead_band       | yaw error behind the controller's filter   | 0      | 4      | -180   | 180    | deg     |
| dead_band       | direction in which it turns the nacelle    | 0      | 1      | -1     | 1      | -       |
| disturbances    | of each of 6 outputs, last 0.1 s           | 0      | 1      | -20    | 20     | -       |
| disturbances    | its change between 12 times up to 15 s ago | 0      | 0.32-1 | -20    | 20     | -       |
| disturbances    | pitch that these ask for: mean, tilt, yaw  | 0      | 1      | -39.5  | 39.5   | deg     |
| disturbances    | share in which offsets act                 | 0.5    | 0.5    | 0      | 1      | -       |
| disturbances    | slow pitch                                 | 5.7    | 5.7    | 0      | 90     | deg     |
| own_response    | what offsets did to each of the 6 outputs  | 0      | 1      | -20    | 20     | -       |
| own_response    | velocity of the tower top fore-aft         | 0      | 0.071  | -1.42  | 1.42   | m/s     |
| own_response    | the same, side-side                        | 0      | 0.029  | -0.58  | 0.58   | m/s     |
| own_response    | displacement of the tower top fore-aft     | 0      | 0.034  | -0.67  | 0.67   | m       |
| own_response    | the same, side-side                        | 0      | 0.014  | -0.27  | 0.27   | m       |
| model_fit       | gain that the model of an output lacks     | -0.7   | 0.5    | -20    | 20     | -       |
| model_fit       | lag that it lacks                          | 0.1    | 0.1    | -10    | 10     | s       |
| supervisor      | 1 in each of its five states, else 0       | 0      | 1      | 0      | 1      | -       |
| supervisor      | mean wind by which it decides              | 15     | 8      | 0      | 60     | m/s     |
| supervisor      | set point of the rotor speed over rated    | 1      | 0.2    | 0      | 1      | -       |
| supervisor      | share of the torque in a start-up          | 1      | 0.5    | 0      | 1      | -       |
| power_reference | demanded power                             | 4      | 0.75   | 0      | 10     | MW      |
| power_reference | electrical power less demanded power       | 0      | 0.25   | -10    | 10     | MW      |
| power_reference | available power by the estimated wind less | 0.5    | 1.25   | -10    | 10     | MW      |
| power_reference | kinetic energy of rotor and generator      | 35.2   | 7      | 0      | 141    | MJ      |
| power_forecast  | demanded power in 2, 5 and 10 s            | 4      | 0.75   | 0      | 10     | MW      |
| dial            | log2 of factors on fatigue, power, travel  | 0      | 1      | -12    | 2      | -       |

By default residual actions see rotor, power, pitch, wind, fixed_frame, tower, controller and offsets, others rotor,
power, pitch, wind, blades, tower, azimuth and previous_action. Single channels beyond the groups: the moments of
the tower base, mean, tilt and yaw of any signal of the blades, for example ``"root_edge_moment_yaw"``, and
``"residual_share"`` and ``"residual_mean"`` where residual pitch fades or is washed out.
Disturbances and own response need linear optimal pitch or an ``observer`` in the base controller; an observer asks for
no pitch. Its six outputs are the flap moments as mean, tilt and yaw, the two accelerations of the nacelle and the rotor
speed, over their scales. A model says what past offsets did to them; what is left of the readings is the disturbance,
which no action changes.
``sensor_noise``, ``sensor_delay`` and ``history`` make readings worse or more; with ``sensors="all"`` the base
controller reads the same instruments. ``sensor_washout`` passes loads, deflections and accelerations, but not
tilt and yaw of flapwise ones, through a high-pass filter, after which their offset is zero. ``variation`` draws
plant, sensors and wind for every episode, ``fault_kinds`` what breaks in it (`wt_gym.envs.faults`).
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

With ``relative_reward`` what the base controller alone earns in the same wind is taken off. With ``reward_credit`` a
step also gets, as the term ``credit``, what its action does to the fatigue terms of the next 15 s by the model of the
observer, less what was credited for this step before; the sum over an episode stays (`wt_gym.envs.credit`).

With a ``power_reference`` the term ``power_tracking`` (weight 0 by default) costs ``w (sqrt(1 + x^2) - 1)`` with x =
(P - P_demanded) / (0.05 R), and what kinetic energy the rotor ends with less than it began with.

With ``dial_weights`` each term is multiplied by the factor of its kind, fatigue, power or travel, that the observation
before the step showed (`wt_gym.envs.dial`); ``set_dial`` turns the dial from the next observation on.

P_available is what the turbine can make of the rotor-effective wind of the episode, up to R: a turbine that takes
what there is and feels no load earns 1 per second in any wind. Further terms, ``tip_deflection``, ``tower_load``,
``extreme_loads`` and ``damage`` (rainflow counting), have weight 0. See `wt_gym.envs.rewards` and ``docs/rewards.md``.

A terminated episode gets the further term ``termination`` = ``-termination_penalty`` (default 120). An early end
never pays: the worst operation costs 5 per second, which is 100 altogether at a discount of 0.99 per 0.2 s, less
than the penalty; and without a discount an idling turbine, feathered and without torque, earns no less than about
0 per second (0 above rated wind, more below) once its rotor has stopped turning fast, which costs 7.

## Starting state

In turbulence the turbine runs, by default (``start="running"``): rotor speed, pitch, generator torque, azimuth and
the swinging tower are those of an instant of a record of the turbine under the baseline in turbulence, after winds
like those before the start (`wt_gym.envs.running_record`). A base controller that is the baseline, or is built on
it, has the memory of that instant; another one starts from its demand. The package has records of the turbines of
the catalog, ``wt-gym record`` makes those of others, and a turbine without a record starts as with
``start="steady"``. With ``start="steady"``, in steady winds, gusts and winds below cut-in and above cut-out, it
starts near its steady operating point (`wt_gym.control.operating_point.operating_point`): rotor speed, pitch and
generator torque of the mean wind speed, azimuth drawn uniformly, tower at rest. So it does where an option fixes
rotor speed, pitch or torque. Structure and wake are as ``Simulator.reset`` leaves them, the yaw angle is 0. At yaw
angle 0 the nacelle faces a wind that blows along +x. Winds made here have their direction against the nacelle, so
that the option ``yaw`` turns the world: actions, observations and rewards stay the same. An inflow of your own
blows from where it does, and meets the rotor with the yaw error that follows from ``yaw``. Extreme winds meet a
parked turbine: rotor at rest, blades feathered, no torque; it needs a negative ``standstill_limit``, and no
built-in base controller supports this case.

``reset(options=...)`` fixes any of ``wind_speed`` [m/s], ``wind_seed``, ``time_offset`` [s], ``rotor_speed``
[rad/s], ``pitch`` [rad], ``azimuth`` [rad], ``yaw`` [rad] and ``generator_torque`` [N m]. The torque is never more
than a generator can brake with at the rotor speed (`wt_gym.simulation.drivetrain.drives.available_torque`): none
at standstill. ``power_reference`` replaces what a grid operator asks for, ``dial`` the factors on the weights of
the reward, ``fault`` chooses the kind of what ``fault_kinds`` would draw, or ``kind``, ``blade``, ``time`` and
``size`` in a mapping. Two more options hold for the episode: ``inflow``, an Inflow in place of the drawn wind, and
``faults``, what breaks in it and when (`wt_gym.simulation.drivetrain.faults`): blades that stick, turn slowly or
slip, a generator that is lost, a shut-down, sensors that read wrong. Actions, observations and the ends of
episodes stay what they are.
With ``starts`` episodes are drawn from so many beginnings, which are the same in every environment with the same
wind, and ``start_number`` chooses one of them.

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
control step and all blades), ``idle_time`` [s], for which the turbine has made no power although the wind over the
rotor lies between cut-in and cut-out and nothing has stopped it (`wt_gym.envs.terminations`), ``reward_terms`` (dict,
after a step), ``saturated`` (tuple of channel names), and for constrained learning, after a step, ``cost``, the sum
of ``costs`` (dict, see `wt_gym.envs.terminations`); with a dial, ``dial`` (dict of the present factors). After a reset
with a ``variation``, ``variation`` (dict of what was drawn), with ``fault_kinds``, ``fault`` (dict). With a
``power_reference``, ``demanded_power`` [W]; with a voltage dip, ``grid_voltage`` over nominal; with a supervisor,
``state`` (text, of `wt_gym.control.controllers.STATES`).
``env.unwrapped.signals`` has every signal of the simulator.
"""
"""What an agent must know: actions, observations, reward, start, end, info."""

ARGUMENTS = """
All by name. Options stand in groups, which are given as objects of `wt_gym.envs.options` or as mappings, and each of
them can be given by its flat name too: ``wind={"speed": 12.0}``, ``wind=WindOptions(speed=12.0)`` and
``wind_speed=12.0`` mean the same. On top of an id of the registry each takes the place of what the id says of it.
Groups have a form in JSON (``to_json``, ``from_json``); ``env.unwrapped.options`` holds all of them.
"""
"""How options are given."""

_ATTRIBUTES = """
Attributes
----------
options : EnvOptions
    What the environment was made of.
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
ValueError, wt_gym.base.errors.InflowError, wt_gym.base.errors.TurbineDefinitionError
    If an argument has no meaning.
"""

NOTES = """
Compiled kernels are cached on disk; the first episode ever compiles them. Make one environment before starting
worker processes, and start those by spawn or forkserver, not fork.

## Version history

v0: first version.
"""
"""What else is to be known."""


def manual() -> str:
    """Give the documentation of the class."""
    parameters = f"Parameters\n----------\n{documentation('')}\n"
    return f"{HEAD}\n## Arguments\n{ARGUMENTS}\n{parameters}{_ATTRIBUTES}\nNotes\n-----{NOTES}"


_WIDTH, _INDENT = 120, 14


def describe(env: WindTurbineEnv, spec: EnvSpec | None, count: int = 1) -> str:
    """Text about an environment, of about ten lines; nothing is simulated for it.

    Parameters
    ----------
    spec : EnvSpec or None
        Definition that it or its vector environment was made of.
    count : int
        Number of turbines.
    """
    turbine, options, (low, high), action = env.turbine, env.options, env.wind.speeds, env.layout.action
    task = None if spec is None else task_of(spec.id)
    title = type(env).__name__ if spec is None else spec.id if task is None else f"{spec.id}: {task.goal}"
    speeds = f"{low:.4g} m/s" if low == high else f"{low:.4g} to {high:.4g} m/s"
    base, beside = options.controller.base, "changed by" if action.mode == "residual" else "beside"
    controller = f"{base if isinstance(base, str) else type(env.controller).__name__}, {beside} the actions"
    conditions = (
        f"faults: {', '.join(options.faults.kinds or ())}" if options.faults.kinds is not None else "",
        f"variation: {', '.join(options.variation.varies)}" if options.variation.varies else "",
        "a power reference" if options.grid.reference is not None else "",
        "a dial on the weights of the reward" if options.dial.weights is not None else "",
    )
    units = set(action.units)
    names = [f"{name} [{unit}]" for name, unit in zip(action.names, action.units, strict=True)]
    actions = ", ".join(names) if len(units) > 1 else f"{', '.join(action.names)} [{units.pop()}]"
    longest = env.length.longest(env.spec, env.outer_steps)
    choice = options.simulator
    simulator = choice if isinstance(choice, str) else choice["name"] if isinstance(choice, Mapping) else "your own"
    rows = {
        "task": ("" if count == 1 else f"{count} turbines, ") + title,
        "turbine": f"{turbine.heading}, {turbine.drivetrain.rated_power / 1e6:.4g} MW, rotor "
        f"{turbine.rotor_diameter:.4g} m, hub {turbine.hub_height:.4g} m",
        "wind": f"{env.wind.label}, {speeds} at hub height",
        "controller": "none: the actions are the demands" if env.controller is None else controller,
        "conditions": "; ".join(part for part in conditions if part),
        "actions": f"{action.size}, {action.mode}, every {env.control_dt:g} s: {actions}",
        "observations": f"{len(env.layout.observation)}: {_short(env.layout.observation.names)}",
        "reward": ", ".join(term.name for term in env.reward_terms),
        "episode": f"{'without a limit of time' if longest is None else f'{longest:g} s'}, start {options.start}, "
        f"fidelity {fidelity_of(env.fidelity).name}{'' if simulator == OWN else f', simulator {simulator}'}",
    }
    wrap = TextWrapper(_WIDTH, subsequent_indent=" " * _INDENT, break_on_hyphens=False)
    return "\n".join(wrap.fill(f"{name:{_INDENT}}{text}") for name, text in rows.items() if text)


def _short(names: Iterable[str]) -> str:
    """Names in a line, neighbors that differ by their last word alone as one: ``pitch_1-3``, ``flap_tilt/yaw``."""
    parts: list[str] = []
    before = None
    for name in names:
        stem, _, last = name.rpartition("_")
        if stem and stem == before:
            counted = last.isdecimal() and last != "1"
            parts[-1] = f"{stem}_1-{last}" if counted else f"{parts[-1]}/{last}"
        else:
            parts.append(name)
        before = stem
    return ", ".join(parts)
