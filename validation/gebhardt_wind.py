"""Wind of the operating points of Gebhardt et al. 2012."""

from wt_gym.turbines.catalogue import gebhardt_data
from wt_gym.wind import SteadyInflow

__all__ = ["boundary_layer"]


def boundary_layer(wind_speed, reference_height=None):
    """Land-surface boundary layer over rural ground, power law with the exponent of open country.

    Parameters
    ----------
    wind_speed : float
        Reference value [m/s].
    reference_height : float, optional
        Where the wind has this speed [m]; by default the gradient height.

    Returns
    -------
    SteadyInflow
    """
    profile = gebhardt_data()["inferred"]["wind_profile"]
    return SteadyInflow(wind_speed, reference_height or profile["reference_height_m"], profile["exponent"])
