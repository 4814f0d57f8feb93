"""An evaluation says whose rotor speed swings, and has seeds of its own for each wind."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from wt_gym.analysis.results import Wind
from wt_gym.experiment.evaluation import FIRST_SEED, EvaluationConfig, oscillation_notes, swings

TIME = np.arange(0.0, 200.0, 0.2)


def run(speed, wind, agent="one"):
    data = xr.Dataset({"rotor_speed": ("time", speed), "wind_x": ("time", wind)}, coords={"time": TIME})
    return SimpleNamespace(agent=agent, data=data, wind=SimpleNamespace(name="14 m/s"))


STEADY, GUSTY = np.full(TIME.size, 14.0), 14.0 + 2.0 * np.sin(0.2 * TIME)


@pytest.mark.parametrize(
    ("amplitude", "middle", "wind", "count"),
    [
        (0.3, 1.0, STEADY, 12),  # 6.4 swings of 31 s, two sides each
        (0.05, 1.0, STEADY, 0),
        (0.2, 0.6, STEADY, 12),  # below rated, in a wind that explains nothing
        (0.2, 0.6, GUSTY, 0),  # below rated the speed follows the wind
        (0.3, 1.0, GUSTY, 12),
    ],
)
def test_swings_are_counted(amplitude, middle, wind, count):
    speed = middle + amplitude * np.sin(0.2 * TIME)
    assert swings(run(speed, wind).data, 1.0) == count
    assert swings(run(speed, wind).data, 1.0, skip=100.0) <= 0.6 * count
    afloat = run(speed, wind).data.assign(platform_pitch=("time", speed))
    assert swings(afloat, 1.0) == (count if wind is STEADY else 0)


def test_the_note_names_agent_wind_and_numbers():
    notes = oscillation_notes(
        [run(2.0 + 0.9 * np.sin(0.2 * TIME), STEADY, "bad"), run(np.full(TIME.size, 2.0), STEADY, "good")], 2.0, 10.0
    )
    assert set(notes) == {"bad"}
    assert "under bad in 14 m/s: it swings between 0.55 and 1.45 times rated" in notes["bad"]


WINDS = tuple(Wind(10.0 + k, 1) for k in range(12))
SEEDS = (0, 1, 7, 999, 1000, 1001, 2000, 11_000, 12_000, 10**6, 2**20, 1000 * 2**20, 2**32 - 1, 2**32)


def test_every_seed_has_its_own_number_in_each_wind():
    numbers = [EvaluationConfig(winds=WINDS, seed=seed).seed_in(wind) for seed, wind in product(SEEDS, WINDS)]
    assert len(set(numbers)) == len(numbers)
    assert min(numbers) == FIRST_SEED
    assert max(numbers) < 2**63
    assert EvaluationConfig(winds=WINDS, seed=7).seed_in(WINDS[2]) == FIRST_SEED + 2007
