"""Trained agents exported as libraries with the Bladed interface, against Python's in the environment."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from envs_tests.unit.exported_library import (
    Exported,
    as_read,
    lost,
    pitches,
    random_readings,
    sanitized,
    together,
    torques,
    write_all_readings,
)  # fmt: skip
from wt_gym.base.errors import SimulationError
from wt_gym.base.files import read_toml
from wt_gym.commands import run as run_command
from wt_gym.control.bladed.records import new_swap, write_lidar
from wt_gym.control.controllers import STATES
from wt_gym.deployment.export.discon import export_discon
from wt_gym.deployment.export.openfast_flight import fly, scene_of
from wt_gym.deployment.export.parts import controller_parts, seen_channels
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.environments import trained_arguments
from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES, TrainedAgent
from wt_gym.simulation import Signals, Simulator
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.wind import PathInflow, SteadyInflow

pytestmark = pytest.mark.usefixtures("compiler")
TRAINED = Path(__file__).resolve().parents[2] / "agents" / "trained"
WIND = {"turbine": "nrel_5mw", "inflow": "turbulent", "wind_speed": 16.0, "start": "steady", "action_mode": "residual"}


def task_arguments(task):
    """Arguments of the newest id of a task, without what makes records and what a library does not have."""
    left_out = {"relative_reward": False, "reward_credit": False, "starts": None, "start": "steady"}
    return TASKS[task].arguments | left_out | {"sensors": "agent", "sensor_noise": 0.0}


AGENTS = {
    name: (agent["algorithm"], getattr(torch.nn, agent["activation"]), agent["arguments"])
    for name, agent in read_toml(Path(__file__).with_name("data") / "exported_agents.toml").items()
} | {"load reduction": ("PPO", torch.nn.Tanh, task_arguments("LoadReduction") | {"wind_speed": 16.0})}
HELD = ("PPO", torch.nn.Tanh, {
    "pitch": "fixed-frame", "action_components": ["pitch"], "residual_fade": True, "episode_length": None,
})  # fmt: skip
"""An agent that sees deflections, which no turbine measures."""


def untrained(folder, kind, gain=60.0, **card):
    """File of a model that acts strongly on what it observes, with its environment; of `AGENTS`, or one like them.

    With PPO, which begins with small actions, those are multiplied by ``gain``. Arguments of the environment in the
    record of its training may differ.
    """
    algorithm, activation, arguments = AGENTS[kind] if isinstance(kind, str) else kind
    env = WindTurbineEnv(**(WIND | arguments))
    policy = {"net_arch": [24, 16], "activation_fn": activation}
    model = ALGORITHM_CLASSES[algorithm]("MlpPolicy", env, policy_kwargs=policy, seed=5)
    if algorithm == "PPO":
        with torch.no_grad():
            model.policy.action_net.weight *= gain
    path = folder / "model.zip"
    model.save(path)
    record = {"algo": algorithm, "env_kwargs": WIND | arguments | card}
    path.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    return path, TrainedAgent(model), env


def fly_both(env, agent, library, parameters, duration, held=(), **options):
    """Largest differences of the demands while an environment and a library read the same single-precision records.

    Returns
    -------
    tuple of float
        Of pitch [rad], yaw rate [rad/s], torque over the greatest one [-], and the largest offset from the controller's
        demand in any of them.
    """
    n, swap = env.turbine.n_blades, new_swap()

    lidar = env.operation.lidar if any(name.startswith("lidar_") for name in env.layout.observation.names) else None

    def seen(instant):
        """What the lidar sees, in single precision."""
        found = look(instant)
        names = dict(zip(lidar.names, found.tolist(), strict=True))
        write_lidar(swap, names | {"yaw": instant[1]}, lidar, env.turbine.hub_height, env.turbine.rotation)
        return found.astype(np.float32).astype(float)

    if lidar is not None:
        look, env.operation._looked = env.operation._looked, seen

    def measured(signals):
        write_all_readings(swap, signals, env.turbine)
        reference = env.operation.reference
        swap[12] = 0.0 if reference is None else reference.at(signals["time"])
        read = Signals(signals.values.copy(), n)
        for name, value in as_read(swap, env.turbine).items():
            if name != "demanded_power" and not name.startswith("lidar_"):
                read.set(name, value)
        return read

    env.operation.measured = measured
    observation, _ = env.reset(seed=2, options=options or {"wind_seed": 7})
    env.operation._filters = [None]  # so that what the controller reads is measured
    ours = Exported(library, env.turbine, parameters, env.demand)
    begin, worst, offset = env.signals["time"], np.zeros(3), 0.0
    advance = env.simulator.advance

    def compared(dt, pitch, yaw_rate, torque, **options):
        nonlocal offset
        ours.swap[_READ] = swap[_READ]
        ours.swap[2000:2500] = swap[2000:2500]
        found = ours.call(env.simulator.time - begin, dt)
        assert ours.flag == 0, ours.message
        most = env.turbine.drivetrain.max_generator_torque
        new = (
            abs(found.pitch - pitch).max(),
            abs(found.yaw_rate - yaw_rate),
            abs(found.generator_torque - torque) / most,
        )
        np.maximum(worst, new, out=worst)
        base = env.base
        added = abs(pitch - base.pitch).max(), abs(yaw_rate - base.yaw_rate), abs(torque - base.generator_torque) / most
        offset = max(offset, *added)
        return advance(dt, pitch, yaw_rate, torque, **options)

    env.simulator.advance = compared
    held = [env.layout.observation.index(name) for name in held]
    for _ in range(round(duration / env.control_dt)):
        observation[held] = 0.0
        action, _ = agent.predict(observation)
        observation, _, terminated, _, info = env.step(action)
        assert not terminated, info["termination"]
    return (*worst.tolist(), offset)


def assert_equal_demands(folder, kind, least):
    """Library and environment demand the same for 9 s, and the agent acts."""
    path, agent, env = untrained(folder, kind)
    files = export_discon(str(path), folder / "exported")["files"]
    pitch, yaw_rate, torque, offset = fly_both(env, agent, *files[1:3], 9.0)
    assert max(pitch, yaw_rate, torque) < 1e-6
    assert offset > least


_READ = np.r_[4, 33, 34, 13:16, 20, 21, 23, 24, 27, 30:33, 37, 53, 54, 60, 69:72, 109, 110, 1001:1019] - 1
"""Records of readings."""


@pytest.mark.parametrize("task", [task for task in TASKS if not task.startswith("IEA")])
def test_agents_of_every_task_can_be_exported(task):
    env = WindTurbineEnv(**task_arguments(task))
    parts = controller_parts(env.controller, env.turbine, env.operation.step)
    seen = seen_channels(env.layout, hold_missing=False)
    assert len(seen) > 10
    assert parts.reads["BASE"]


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_an_agent_of_every_task_demands_what_it_demands_in_its_environment(task, tmp_path):
    arguments = {key: list(value) if isinstance(value, tuple) else value for key, value in task_arguments(task).items()}
    more = {"Dial": {"dial_weights": {"fatigue": 2.0}}, "Faults": {"fault_kinds": None}}.get(task, {})
    assert_equal_demands(tmp_path, ("PPO", torch.nn.Tanh, arguments | more), least=1e-4)


@pytest.mark.parametrize("kind", [kind for kind in AGENTS if "operation" not in kind])
def test_an_agent_demands_what_it_demands_in_its_environment(kind, tmp_path):
    assert_equal_demands(tmp_path, kind, least=1e-3)


PROFILE = SteadyInflow(1.0, 90.0, shear_exponent=0.2)
START_TO_STORM = PathInflow(np.array([0.0, 5.0, 50.0, 70.0]), np.array([1.0, 12.0, 18.0, 28.0]), PROFILE)
INTO_STORM = PathInflow(np.array([0.0, 10.0, 30.0]), np.array([24.0, 34.0, 34.0]), PROFILE)


@pytest.mark.parametrize("kind", ["full operation", pytest.param("full operation, offsets", marks=pytest.mark.slow)])
def test_an_agent_on_a_supervisor_does_from_standstill_to_storm(kind, tmp_path):
    """Parked, started, in production with moved set points, held back, stopped: the states that it sees with it."""
    path, agent, env = untrained(tmp_path, kind)
    files = export_discon(str(path), tmp_path / "exported")["files"]
    begin = {"rotor_speed": 0.0, "pitch": 0.5 * math.pi, "generator_torque": 0.0}
    states, step, asked = set(), env.step, []

    def noted(action):
        result = step(action)
        states.add(result[-1]["state"])
        asked.append(env.setpoint.set_point)
        return result

    env.step = noted
    for inflow, duration, start in ((START_TO_STORM, 65.0, begin), (INTO_STORM, 20.0, {})):
        pitch, yaw_rate, torque, offset = fly_both(env, agent, *files[1:3], duration, inflow=inflow, **start)
        assert max(pitch, yaw_rate, torque) < 1e-6
        assert offset > 1e-3
    assert states == set(STATES)
    assert np.ptp(asked) > 0.05


def test_the_dial_of_a_library_is_a_parameter_of_its_file(tmp_path):
    """An agent that was trained with drawn factors keeps to equal ones until the file says others."""
    path, agent, env = untrained(tmp_path, "dial", dial_weights="log_uniform")
    library, parameters = (Path(file) for file in export_discon(str(path), tmp_path / "exported")["files"][1:3])
    line = next(one for one in parameters.read_text(encoding="utf-8").splitlines() if one.startswith("dial ="))
    assert line.startswith("dial = 1.0 1.0 1.0  # -, factors on the weights of fatigue, power and travel")
    assert max(fly_both(env, agent, library, parameters, 3.0)[:3]) > 1e-5  # the environment has others
    turned = parameters.read_text(encoding="utf-8").replace(line, "dial = 6 2 1")
    parameters.write_text(turned, encoding="utf-8")
    assert max(fly_both(env, agent, library, parameters, 3.0)[:3]) < 1e-6


@pytest.mark.parametrize("duration", [20.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_an_agent_with_held_channels_does_too(duration, tmp_path):
    path, agent, env = untrained(tmp_path, HELD)
    made = export_discon(str(path), tmp_path / "exported", hold_missing=True)
    assert made["held"][0] == "tip_out_of_plane_mean"
    assert "does not have tip_out_of_plane_mean" in Path(made["files"][3]).read_text(encoding="utf-8")
    pitch, yaw_rate, torque, offset = fly_both(env, agent, *made["files"][1:3], duration, made["held"])
    assert max(pitch, yaw_rate, torque) < 1e-5
    assert offset > 1e-2


def demands_over(env, duration, act):
    """Demands on the drives at every step of the simulator, and mean power [W], over an episode in the same wind."""
    observation, _ = env.reset(seed=2, options={"wind_seed": 7})
    rows, powers, advance = [], [], env.simulator.advance

    def noted(dt, pitch, yaw_rate, torque, **options):
        rows.append([*pitch, torque / env.turbine.drivetrain.max_generator_torque])
        return advance(dt, pitch, yaw_rate, torque, **options)

    env.simulator.advance = noted
    for _ in range(round(duration / env.control_dt)):
        observation, *_, info = env.step(act(observation))
        powers.append(info["generator_power"])
    return np.array(rows), float(np.mean(powers))


def test_a_library_damps_the_tower_of_a_nacelle_that_heads_elsewhere(tmp_path, monkeypatch):
    """Its accelerations come along axes that do not yaw, and it acts as Python's controller does."""
    name, direction, duration = "constrained_ipc+tower_dampers", 1.0, 20.0
    reset = Simulator.reset

    def turned(self, *words, **options):
        return reset(self, *words, **(options | {"yaw": direction}))

    monkeypatch.setattr(Simulator, "reset", turned)
    made = export_discon(name, tmp_path)["files"]
    wind = WIND | {"episode_length": None, "pitch": "fixed-frame", "action_components": ["pitch"]}
    wind |= {"wind_direction": direction}
    library, rows = f"bladed:{made[1]}:input_file={made[2]}", []
    for controller in (name, library):
        env = WindTurbineEnv(**wind, controller=controller)
        rows.append(demands_over(env, duration, lambda obs: np.zeros(3))[0])
        assert env.signals["yaw"] == pytest.approx(direction, abs=1e-6)
    assert abs(rows[1] - rows[0]).max() < 1e-5
    undamped = demands_over(WindTurbineEnv(**wind, controller="constrained_ipc"), duration, lambda obs: np.zeros(3))[0]
    assert abs(undamped - rows[0]).max() > 1e-3  # dampers do act


@pytest.mark.parametrize("duration", [20.0, pytest.param(600.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["constrained_ipc+tower_dampers", "load_reduction", "load reduction"])
def test_closed_loops_with_the_library_and_with_python_are_alike(name, duration, tmp_path):
    """The library reads single precision: its loop is another one after rounding, and stays beside Python's."""
    wind = WIND | {"episode_length": None, "pitch": "fixed-frame", "action_components": ["pitch"]}
    choice = name
    if name in AGENTS:
        choice, agent, env = untrained(tmp_path, name, gain=6.0)  # strong feedback makes rounding grow
    elif (choice := TRAINED / name).exists():
        agent = TrainedAgent.load(choice)
        arguments = trained_arguments(agent.record) | {"wind_speed": 16.0, "episode_length": None, "start": "steady"}
        arguments |= {"relative_reward": False, "reward_credit": False, "starts": None}
        env = WindTurbineEnv(**arguments)
    else:
        choice, env = name, WindTurbineEnv(**wind, controller=name)
    made = export_discon(str(choice), tmp_path)
    act = (lambda observation: np.zeros(3)) if choice == name else (lambda observation: agent.predict(observation)[0])
    expected, power = demands_over(env, duration, act)
    library = f"bladed:{made['files'][1]}:input_file={made['files'][2]}"
    other = WindTurbineEnv(**wind, controller=library, control_dt=env.control_dt)
    found, as_library = demands_over(other, duration, lambda observation: np.zeros(3))
    assert as_library == pytest.approx(power, rel=1e-6)
    assert abs(found - expected).max() < 1e-5


def two_libraries(tmp_path, change="", kind="fixed frame"):
    """An agent as a library, with other parameters if given, its base controller's, and a turbine."""
    path, *_ = untrained(tmp_path, kind)
    files = export_discon(str(path), tmp_path / "agent")["files"]
    if change:
        Path(files[2]).write_text(change, encoding="utf-8")
    base = export_discon(AGENTS[kind][2]["controller"], tmp_path / "base")["files"]
    turbine = load_turbine("nrel_5mw")
    return Exported(*files[1:2], turbine, files[2]), Exported(*base[1:2], turbine, base[2]), turbine, files


def test_an_agent_rests_while_a_reading_is_missing(tmp_path):
    """Its offsets return to zero at their greatest rate; when the reading is back, it acts again."""
    ours, base, turbine, _ = two_libraries(tmp_path)
    # above rated, where nothing fades
    fast = {"rotor_speed": 1.3, "generator_speed": 1.3 * turbine.drivetrain.gear_ratio}
    signals = [now | fast for now in random_readings(turbine, 500, 4, 0.1)]
    # the wind speed, which the controller does not read
    found, alone, said = together((ours, signals), (base, signals), spoil=lost(27, since=200, until=350))
    apart = abs(pitches(found) - np.maximum(pitches(alone), turbine.pitch.min_pitch)).max(axis=1)
    assert max(apart[100:200]) > 0.05
    back = 200 + math.ceil(4.0 / 1.5 / 0.1) + 4  # from the limit at the greatest rate, begun at a control step
    assert max(apart[back:350]) < 1e-7
    assert max(apart[400:]) > 0.05
    assert [(k, flag) for k, flag, _ in said] == [(200, 1)]
    assert "wind speed at the hub (record 27)" in said[0][2]


def test_the_set_point_of_an_agent_rests_with_it(tmp_path):
    """Without the azimuth from the first call on, or switched off, nothing holds the turbine back.

    The set points of the controller end below the speed of cut-in, where those of an agent do not.
    """
    _, base, turbine, files = two_libraries(tmp_path, kind="full operation")
    texts = ["supervisor_least_speed = 0.5\nsupervisor_least_power = 0.3\n"] * 4
    texts[1] += "agent = 0\n"
    libraries = [base]
    for k, text in enumerate(texts):
        parameters = tmp_path / f"{k}.in"
        parameters.write_text(text, encoding="utf-8")
        if k > 0:
            libraries.append(Exported(files[1], turbine, parameters))
    base.input_file = str(tmp_path / "0.in")
    base.swap[49] = len(base.input_file) + 1
    apart = 0.0
    for wind in (15.0, 29.5):
        for library in libraries:
            library.calls = 0
        speed = 1.25 if wind < 20.0 else 0.7
        now = {"rotor_speed": speed, "generator_speed": speed * turbine.drivetrain.gear_ratio, "wind_x": wind}
        signals = [drawn | now for drawn in random_readings(turbine, 150, 4, 0.1)]
        first, second, resting_one, third = libraries
        flights = [(library, signals) for library in (resting_one, first, second, third)]
        resting, alone, off, acting, _ = together(*flights, spoil=lost(60))
        compared = [off] if wind > 20.0 else [off, resting]
        # an agent that rests asks for no less than the speed of cut-in, as one that does nothing
        for demands in compared:
            assert np.array_equal(pitches(demands), pitches(alone))
            assert np.array_equal(torques(demands), torques(alone))
        apart = max(apart, abs(torques(acting) - torques(alone)).max())
    assert apart > 1e3


def test_a_checkpoint_keeps_the_agent_too(tmp_path):
    ours, _, turbine, files = two_libraries(tmp_path)
    other = Exported(files[1], turbine, files[2])
    signals = list(random_readings(turbine, 200, 6, 0.1))
    together((ours, signals[:100]))
    ours.call(9.9, 0.1, status=-8)
    shutil.copy(f"{ours.library.output_name}.9900.checkpoint", other.library.output_name.rpartition("/")[0])
    other.call(9.9, 0.1, status=-9)
    assert other.flag == 0
    expected, found, _ = together((ours, signals[100:]), (other, signals[100:]), first=100)
    assert np.array_equal(pitches(found), pitches(expected))


def test_sanitizers_find_nothing_in_agents(tmp_path):
    path, *_ = untrained(tmp_path, "fixed frame")
    source, _, parameters, _ = export_discon(str(path), tmp_path / "exported")["files"]
    sanitized(source, parameters, tmp_path)


def test_channels_that_the_interface_lacks_are_refused_with_their_names(tmp_path):
    path, *_ = untrained(tmp_path, HELD)
    words = [str(path), "--to", "discon", "--out", str(tmp_path / "exported")]
    lacking = r"got tip_out_of_plane_mean, .*tower_top_side_side, which are not. Train it with observation='measurable'"
    with pytest.raises(SystemExit, match=lacking):
        run_command("export", words)
    with pytest.raises(SystemExit, match="turbine and interval are those of the agent's training"):
        run_command("export", [*words, "--turbine", "iea_15mw"])


def test_actions_that_are_not_residual_are_refused(tmp_path):
    kind = ("PPO", torch.nn.Tanh, {"action_mode": "rate", "observation": ["rotor"]})
    path, *_ = untrained(tmp_path, kind)
    with pytest.raises(ValueError, match=r"must have residual actions .*, got 'rate'"):
        export_discon(str(path), tmp_path / "out")


@pytest.fixture
def no_openfast(monkeypatch):
    """No program of OpenFAST is installed."""

    def missing(_given=None):
        raise SimulationError("not here")

    for name in ("find_driver", "find_library"):
        monkeypatch.setattr(f"wt_gym.deployment.export.openfast_flight.{name}", missing)


@pytest.mark.parametrize("wrong", [False, True], ids=["as exported", "a tenth of the yaw"])
def test_a_flight_compares_yaw_without_the_noise_of_the_training(wrong, tmp_path, no_openfast, monkeypatch, capsys):
    path, *_ = untrained(tmp_path, "yaw", sensor_noise=0.1)

    def export(*names, **options):
        made = export_discon(*names, **options)
        parameters = Path(made["files"][2])
        text = parameters.read_text(encoding="utf-8")
        (found,) = re.findall(r"^offset_yaw_rate = (\S+)", text, re.MULTILINE)
        slower = text.replace(f"offset_yaw_rate = {found}", f"offset_yaw_rate = {0.1 * float(found)}")
        parameters.write_text(slower if wrong else text, encoding="utf-8")
        return made

    monkeypatch.setattr("wt_gym.deployment.export.openfast_flight.export_discon", export)
    words = [str(path), "--out", str(tmp_path / "flight"), "--duration", "4", "--skip", "1", "--json", "--env-kwargs",
             '{"inflow": "steady", "wind_speed": 12.0}']  # fmt: skip
    if wrong:
        with pytest.raises(SystemExit):
            run_command("fly", words)
    else:
        run_command("fly", words)
    text = capsys.readouterr().out
    told = json.loads(text.splitlines()[-1])
    assert told["agrees"] is not wrong
    assert (told["yaw_rate_rad_s"] > 2e-5) is wrong
    assert "without sensor noise" in text


def test_a_flight_in_a_storm_begins_parked_in_both(tmp_path, no_openfast):
    """Python's supervisor lets the turbine stand; so does the library, of which the environment knows nothing."""
    choice = "discon+supervisor"
    wind = {"inflow": "steady", "standstill_limit": -0.5, "wind_speed": 29.0}
    flight = fly(choice, tmp_path, scene_of(choice, env_kwargs=wind, duration=3.0), duration=3.0)
    assert max(flight.pitch, flight.torque) < 1e-6
    assert flight.metrics["wt_gym, library"]["mean_power"] == 0.0
    begins = InputFile(tmp_path / "openfast" / "elastodyn.dat")
    assert begins.number("RotSpeed") < 0.1
    assert begins.number("BlPitch(1)") == pytest.approx(90.0)
