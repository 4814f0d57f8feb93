"""The physical layer between an agent and a turbine: actions to actuator demands, sensors, steady operating points."""

from wt_gym.control.actions import ACTION_MODES, COMPONENTS, PITCH_FORMS, ActionMap, AgentSetpoint, Demand
from wt_gym.control.design import DesignPoint, design_point
from wt_gym.control.operating_point import OperatingPoint, TorqueCurve, operating_point, torque_curve
from wt_gym.control.sensors import Channel, Lidar, LowPass, NacelleAnemometer, Notch

__all__ = [
    "ACTION_MODES",
    "COMPONENTS",
    "PITCH_FORMS",
    "ActionMap",
    "AgentSetpoint",
    "Channel",
    "Demand",
    "DesignPoint",
    "Lidar",
    "LowPass",
    "NacelleAnemometer",
    "Notch",
    "OperatingPoint",
    "TorqueCurve",
    "design_point",
    "operating_point",
    "torque_curve",
]
