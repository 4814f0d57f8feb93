"""Controllers and agents with predict in the same winds: actions that rest are the base controller, exactly."""

from wt_gym.analysis.results import Wind
from wt_gym.experiment.comparison import ComparisonConfig, run_cases
from wt_gym.turbines import load_turbine

RESTS = """
import numpy as np

class Rests:
    env_kwargs = {"action_mode": "residual"}
    def __init__(self, layout):
        self.size = layout.action.size
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(self.size, dtype=np.float32), state
"""


def test_agents_and_controllers_start_alike(tmp_path):
    (tmp_path / "mine.py").write_text(RESTS)
    agents = {"a": ("discon", {}), "b": (f"{tmp_path / 'mine.py'}:Rests", {}), "c": ("zero", {}), "d": ("ipc", {})}
    runs = run_cases(load_turbine("nrel_5mw"), agents, [Wind(15.0)], ComparisonConfig(duration=4.0, skip=1.0))
    found = [run.metrics[Wind(15.0)] for run in runs]
    assert found[0] == found[1] == found[2] != found[3]
