"""A turbine that makes no power in wind between cut-in and cut-out says so: in ``info``, in the run, in commands."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from envs_tests.env.scripted_simulator import ScriptedSimulator, scripted_signals, use
from wt_gym.analysis.metrics import idle_sentence, idle_time
from wt_gym.analysis.results import Wind
from wt_gym.commands import benchmark
from wt_gym.commands import run as run_command
from wt_gym.envs.terminations import IDLE_POWER, LEAST_SPELL, IdleClock
from wt_gym.envs.terms import Transition
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.evaluation import EvaluationConfig
from wt_gym.experiment.loadcase_report import load_case_tables
from wt_gym.experiment.loadcase_runs import CaseRun, LoadCaseResults
from wt_gym.experiment.robustness import Robustness, chosen
from wt_gym.experiment.run import play, run_controller
from wt_gym.learning import callbacks
from wt_gym.simulation.drivetrain.faults import SensorBias, ShutDown, StuckPitch, VoltageDip
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

HOLD = np.zeros(3, dtype=np.float32)
STOPS_AT = 5.0


class Standing(ScriptedSimulator):
    """Makes no power from 5 s on: the rotor stands."""

    script = {STOPS_AT: {"rotor_speed": 0.0}}  # noqa: RUF012


@pytest.fixture
def make_env(monkeypatch):
    use(monkeypatch, Standing)
    return lambda **kwargs: WindTurbineEnv(standstill_limit=-1.0, **{"wind_speed": 8.0} | kwargs)


class Zero:
    """Agent that holds."""

    def predict(self, observation, **_):
        """Zero action."""
        return HOLD, None


def idle_times(env, steps, **options):
    """Values of ``idle_time`` at the reset and after the steps."""
    env_action = np.zeros(env.action_space.shape, np.float32)
    _, info = env.reset(seed=0, options=options)
    return [info["idle_time"], *(env.step(env_action)[-1]["idle_time"] for _ in range(steps))]


def test_info_counts_from_the_last_power_on(make_env):
    times = idle_times(make_env(), 40)
    assert times[:25] == [0.0] * 25  # power at the end of all these steps
    np.testing.assert_allclose(times[25:], 0.2 * np.arange(1, 17), atol=1e-9)
    assert idle_times(make_env(), 3) == [0.0] * 4


def test_power_begins_a_new_spell(make_env, monkeypatch):
    rated = load_turbine("nrel_5mw").drivetrain.rated_rotor_speed
    monkeypatch.setattr(Standing, "script", {1.0: {"rotor_speed": 0.0}, 2.0: {"rotor_speed": rated}})
    env = make_env(action_mode="absolute")
    env.reset(seed=0)
    full = np.array([0.0, 0.0, 1.0], np.float32)  # the last component is the torque
    times = [env.step(full)[-1]["idle_time"] for _ in range(10)]
    assert times == pytest.approx([0.0] * 4 + [0.2, 0.4, 0.6, 0.8, 1.0, 0.0])


@pytest.mark.parametrize(
    ("kwargs", "options"),
    [
        ({"wind_speed": 2.5, "inflow": "steady"}, {}),  # below cut-in
        ({"wind_speed": 26.0, "inflow": "steady"}, {}),  # above cut-out
        ({}, {"faults": (ShutDown(time=1.0),)}),
        ({}, {"faults": (VoltageDip(time=1.0, duration=100.0),)}),
    ],
)
def test_a_reason_stops_the_clock(make_env, monkeypatch, kwargs, options):
    monkeypatch.setattr(Standing, "faults", ())
    assert max(idle_times(make_env(**kwargs), 40, **options)) == 0.0


@pytest.mark.parametrize(
    "fault",
    [StuckPitch(time=1.0, blade=1), VoltageDip(time=1.0), ShutDown(time=100.0), SensorBias(1.0, ("rotor_speed",))],
)
def test_faults_that_do_not_stop_the_turbine_are_no_reason(make_env, fault):
    assert idle_times(make_env(), 40, faults=(fault,))[-1] > 2.0


def test_a_supervisor_and_a_grid_operator_stop_the_clock_and_power_ends_a_spell():
    """Spells count in a run from the least length on; no wind is asked for while the turbine makes power."""
    turbine = load_turbine("nrel_5mw")
    clock, still = IdleClock(turbine), scripted_signals({"wind_x": 8.0})
    controller = SimpleNamespace(runs_in=lambda wind: True, in_production=False)
    times = []
    for producing, demanded in ((False, None), (True, None), (True, 0.0)):
        controller.in_production = producing
        clock.advance(Transition(turbine, still, still, 0.2, demanded_power=demanded), controller)
        times.append(clock.time)
    assert times == [0.0, 0.2, 0.0]
    clock, least = IdleClock(turbine), IDLE_POWER * turbine.drivetrain.rated_power
    runs = scripted_signals({"wind_x": 8.0, "generator_power": least})
    for count, total in ((LEAST_SPELL - 1, 0.0), (LEAST_SPELL, LEAST_SPELL), (30, 30.0 + LEAST_SPELL)):
        for _ in range(int(count)):
            clock.advance(Transition(turbine, still, still, 1.0))
        clock.advance(Transition(turbine, still, runs, 1.0))
        assert clock.total == total
    clock.begin(None)
    assert (clock.time, clock.total) == (0.0, 0.0)


def test_recorded_runs_hold_the_time(make_env):
    episode = play(make_env(episode_length=None), Zero(), seed=0, options={}, duration=30.0)
    assert idle_time(episode.data) == pytest.approx(25.2)
    assert idle_time(episode.after_start) == pytest.approx(25.2)
    turbine = load_turbine("nrel_5mw")
    simulator = Standing(turbine, SteadyInflow(8.0, hub_height=turbine.hub_height))

    class Same:
        channels = ()

        def start(self, signals, demand):
            """Hold this demand."""
            self.demand = demand

        def step(self, signals, dt):
            """Hold."""
            return self.demand

    run = run_controller(simulator, Same(), 30.0).to_dataset()  # which begins without torque
    assert idle_time(run) == pytest.approx(30.0)


def test_the_sentence_names_agent_winds_and_times():
    assert idle_sentence("discon", [("8 m/s", 0.0)]) is None
    sentence = idle_sentence("discon", [("8 m/s", 52.2), ("9 m/s", 0.0), ("10 m/s", 20.0)])
    assert sentence.startswith("discon made no power for 52 s in 8 m/s, 20 s in 10 m/s, although the wind")
    assert "and in 3 more winds" in idle_sentence("a", [(f"{v} m/s", 30.0) for v in range(7)])


SENTENCE = "made no power for 25 s in 8 m/s"


def test_evaluate_says_so(make_env, tmp_path, capsys):
    words = ["baseline", "--env", "wt_gym/NREL5MW-Steady-v1", "--wind-speed", "8", "--duration", "30", "--skip", "2"]
    kwargs = ["--env-kwargs", json.dumps({"standstill_limit": -1.0})]
    for _ in ("made", "resumed"):
        run_command("evaluate", [*words, *kwargs, "--replay", "0", "--no-report", "--out", str(tmp_path)])
        assert capsys.readouterr().out.count(f"discon {SENTENCE}") == 1


def test_the_evaluation_of_a_training_says_so(make_env, caplog):
    config = EvaluationConfig(
        "wt_gym/NREL5MW-Steady-v1", {"standstill_limit": -1.0}, (Wind(8.0),), duration=30.0, skip=2.0, replay=0.0
    )
    for agent, name in ((Zero(), "agent"), ("baseline", "baseline")):
        callbacks._run(agent, config)
        assert [record.message for record in caplog.records if SENTENCE in record.message][-1].startswith(name)


def test_simulate_and_compare_controllers_say_so(monkeypatch, capsys):
    monkeypatch.setattr("wt_gym.envs.operation.Simulator", Standing)
    run_command("simulate", ["--wind-speed", "8", "--duration", "30"])
    assert capsys.readouterr().out.count(f"The baseline controller {SENTENCE}") == 1
    words = ["discon", "--wind-speed", "8", "--wind-seeds", "--duration", "28", "--skip", "2"]
    run_command("compare-controllers", words)
    assert capsys.readouterr().out.count(f"discon {SENTENCE}") == 1


def test_benchmark_and_load_cases_and_conditions_say_so():
    result = {"agent": "discon", "definition": {"task": "gust", "wind": {"speed": 8.0, "seed": 3}}, "idle_time": 25.0}
    (line,) = benchmark.idle_lines([result, {**result, "idle_time": 0.0}])
    assert line.startswith("discon made no power for 25 s in 8 m/s, seed 3 of gust")
    found = Robustness({}, "discon", {"discon": None}, chosen([]), {}, {}, {"nominal": [f"discon {SENTENCE}."]})
    assert f"nominal: discon {SENTENCE}." in found.to_markdown()
    condition = SimpleNamespace(name="1.1 at 8 m/s")
    runs = {("1.2", "ipc"): [CaseRun("ipc", condition, {"ending": "time", "idle_time": 25.0})]}
    results = LoadCaseResults("turbine", ("1.2",), ("ipc",), runs, None, {})
    assert load_case_tables(results)[-1].startswith("ipc made no power for 25 s in 1.1 at 8 m/s")
