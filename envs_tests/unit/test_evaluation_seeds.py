"""Seeds of the environment in evaluations."""

from itertools import product

from wt_gym.analysis.results import Wind
from wt_gym.experiment.evaluation import FIRST_SEED, EvaluationConfig

WINDS = tuple(Wind(10.0 + k, 1) for k in range(12))
SEEDS = (0, 1, 7, 999, 1000, 1001, 2000, 11_000, 12_000, 10**6, 2**20, 1000 * 2**20, 2**32 - 1, 2**32)


def test_every_seed_has_its_own_number_in_each_wind():
    numbers = [EvaluationConfig(winds=WINDS, seed=seed).seed_in(wind) for seed, wind in product(SEEDS, WINDS)]
    assert len(set(numbers)) == len(numbers)
    assert min(numbers) == FIRST_SEED
    assert max(numbers) < 2**63
    assert EvaluationConfig(winds=WINDS, seed=7).seed_in(WINDS[2]) == FIRST_SEED + 2007
