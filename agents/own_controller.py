"""Write a controller of pitch and torque, and compare it with the published one.

    python agents/own_controller.py

`IndividualPitch` is a whole controller for the NREL 5-MW turbine: a torque law and a gain-scheduled PI controller of
the pitch with the published gains, and individual pitch control on top. The class can be named wherever a controller is
asked for, here too as a base for an agent, which then has neither the observation nor the credit by an observer:

    own = "agents/own_controller.py:IndividualPitch:gain=2e-9"
    gym.make("wt_gym/LoadReduction-v3", controller=own, observation=None, reward_credit=False)
"""

import argparse

import numpy as np

from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import paired_change
from wt_gym.control import Demand
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate

RATED_SPEED, PI_SPEED = 121.6805, 122.9096  # of the generator: where the torque law and the pitch take over [rad/s]
POWER, MOST_TORQUE = 5.296610e6, 47402.91  # mechanical [W], [N m]
SHOWN = ("blade_flap_del", "tower_fore_aft_del", "mean_power", "pitch_travel", "rotor_speed_max")


class IndividualPitch:
    """Torque and collective pitch of Jonkman et al. (NREL/TP-500-38060, section 7), and individual pitch control.

    Parameters
    ----------
    gain : float
        Of the individual pitch control [rad/(s N m)]; 0: collective pitch alone.
    """

    channels = ("generator_speed", "azimuth", *(f"root_flap_moment_{b}" for b in (1, 2, 3)))

    def __init__(self, gain=2e-9):
        self.gain = gain

    def start(self, signals, demand):
        """Take over from the current demand."""
        self.speed, self.integral, self.offsets = signals["generator_speed"], float(np.mean(demand.pitch)), np.zeros(2)

    def step(self, signals, dt):
        """Return the demand for the next dt seconds."""
        self.speed += (1.0 - np.exp(-2.0 * np.pi * 0.25 * dt)) * (signals["generator_speed"] - self.speed)  # 0.25 Hz

        # torque: best tip-speed ratio below rated wind, a steep line up to rated torque, constant power above
        torque = POWER / max(self.speed, 1.0)
        if self.integral < np.radians(1.0):
            optimal = 0.02332287 * (self.speed * 30.0 / np.pi) ** 2  # N m/rpm^2
            line = POWER / RATED_SPEED * (self.speed - RATED_SPEED / 1.1) / (RATED_SPEED - RATED_SPEED / 1.1)
            torque = min(max(optimal, line), torque)

        # collective pitch: PI on the speed error, weaker at large pitch where blades are more sensitive
        error, schedule = self.speed - PI_SPEED, 1.0 / (1.0 + self.integral / 0.1099965)
        self.integral = min(max(self.integral + 0.008068634 * schedule * error * dt, 0.0), np.pi / 2)
        collective = max(self.integral + 0.01882681 * schedule * error, 0.0)

        # individual pitch: integrate the tilting and yawing parts of the flap moments (Bossanyi, Wind Energy 6, 2003)
        angles = signals["azimuth"] + 2.0 * np.pi / 3.0 * np.arange(3)
        turn = np.array([np.cos(angles), np.sin(angles)])
        moments = np.array([signals[f"root_flap_moment_{b}"] for b in (1, 2, 3)])
        self.offsets = np.clip(self.offsets + self.gain * dt * 2.0 / 3.0 * (turn @ moments), -0.07, 0.07)
        fade = min(collective / 0.1, 1.0)  # none where the pitch is at its best for power
        return Demand(collective + fade * (self.offsets @ turn), 0.0, min(torque, MOST_TORQUE))


def main():
    """Run it in turbulence beside the published controller, and print the changes in the same winds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--winds", type=int, default=4, help="at each of 8 and 16 m/s (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=180.0, help="of a run, s (default: %(default)s)")
    arguments = parser.parse_args()
    own = f"{__file__}:IndividualPitch"
    agents = {"discon": "discon", "collective": f"{own}:gain=0", "individual": own}  # the first is the baseline
    for speed in (8.0, 16.0):
        winds = tuple(Wind(speed, 1001 + k) for k in range(arguments.winds))
        config = EvaluationConfig(
            "wt_gym/NREL5MW-Turbulent-v1", {"action_mode": "residual"}, winds, duration=arguments.duration,
            skip=min(30.0, arguments.duration / 3), replay=0.0,
        )  # fmt: skip
        evaluation = evaluate(agents, config)
        for agent in list(agents)[1:]:
            for key in SHOWN:
                change = paired_change(evaluation, agent, key)
                factor, unit = (100.0, "%") if change.relative else (1.0, METRICS[key].unit)
                print(f"{speed:g} m/s, {agent:10s} {METRICS[key].label:30s} {factor * change.value:+6.1f} {unit}")


if __name__ == "__main__":
    main()
