"""The physical layer between an agent and a turbine: actions to actuator demands, sensors, steady operating points."""

from wt_gym.control.actions import ActionMap, Demand
from wt_gym.control.operating_point import (
    DesignPoint,
    OperatingPoint,
    TorqueCurve,
    design_point,
    operating_point,
    torque_curve,
)
from wt_gym.control.sensors import Channel, LowPass, NacelleAnemometer

__all__ = [
    "ActionMap",
    "Channel",
    "Demand",
    "DesignPoint",
    "LowPass",
    "NacelleAnemometer",
    "OperatingPoint",
    "TorqueCurve",
    "design_point",
    "operating_point",
    "torque_curve",
]
