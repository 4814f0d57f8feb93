"""The weighted lifetime cost: what a change of loads, power and drive use is worth, in one place."""

from __future__ import annotations

__all__ = ["LIFETIME_COST_WEIGHTS"]

LIFETIME_COST_WEIGHTS = {
    "captured_power": -1.0,
    "blade_flap_del": 0.2,
    "blade_edge_del": 0.05,
    "tower_fore_aft_del": 0.15,
    "tower_side_side_del": 0.05,
    "pitch_duty_cycle": 0.1,
    "torque_rate": 0.05,
}
"""Change of the cost of energy by a relative change of each metric of `wt_gym.experiment.run.benchmark_metrics`.

One per cent of energy is worth one per cent of the cost. A load that rises by one per cent asks for about as much more
material where fatigue decides: the weights are about the shares of blades and tower in the cost of a turbine (some 20 %
each: Fingersh, Hand and Laxson, NREL/TP-500-40566). What a drive does counts over its full use, not relative to the
baseline: the full use of the pitch drive, day and night, costs a tenth of the turbine. The tasks of the benchmark are
frozen and hold these numbers in their files.
"""
