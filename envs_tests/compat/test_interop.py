"""The examples of ``docs/interop.md``, each where its library is installed."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "interop.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r"^## (\S+)\n.*?^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
LIBRARIES = {
    "stable-baselines3": "stable_baselines3", "CleanRL": "gymnasium", "RLlib": "ray.rllib", "TorchRL": "torchrl",
    "Minari": "minari", "MO-Gymnasium": "mo_gymnasium",
}  # fmt: skip


@pytest.mark.parametrize("library", LIBRARIES)
def test_examples_run(library, scripted, monkeypatch, tmp_path):
    name = LIBRARIES[library]
    if importlib.util.find_spec(name.partition(".")[0]) is None:
        pytest.skip(f"{library} is not installed")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(EXAMPLES[library], f"docs/interop.md, {library}", "exec"), names)
    match library:
        case "stable-baselines3":
            assert names["env"].action_space.contains(names["action"])
        case "CleanRL":
            assert names["reward"].shape == (2,)
        case "RLlib":
            assert names["result"]["env_runners"]["num_env_steps_sampled"] >= 100
        case "TorchRL":
            assert names["reward"].shape == (10, 1)
        case "Minari":
            assert len(names["episode"].rewards) > 0
            assert (tmp_path / "runs" / "datasets" / "turbine" / "ipc-v0").is_dir()
        case "MO-Gymnasium":
            assert names["reward"] == pytest.approx(np.sum(names["info"]["vector_reward"]))
            assert len(names["info"]["vector_reward"]) == len(names["names"])


def test_every_library_has_its_example():
    assert EXAMPLES.keys() == LIBRARIES.keys()
