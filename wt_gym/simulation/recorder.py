"""Recording of signals into a labelled data set."""

from pathlib import Path

import numpy as np

from wt_gym.files import write_netcdf_whole
from wt_gym.simulation.channels import channel_table

__all__ = ["Recorder"]


class Recorder:
    """Collects signals and turns them into an xarray data set with units.

    Parameters
    ----------
    simulator : Simulator
        Gives the channels and the attributes of the data set.
    **attributes
        Further attributes of the data set (numbers and strings).

    Examples
    --------
    >>> recorder = Recorder(sim)                         # doctest: +SKIP
    >>> recorder.append(sim.advance(0.2, **commands))    # doctest: +SKIP
    >>> recorder.to_dataset().to_netcdf("run.nc", engine="h5netcdf")  # doctest: +SKIP
    """

    def __init__(self, simulator, **attributes):
        self.channels = channel_table(simulator.turbine.n_blades)
        self.attributes = {
            "turbine": simulator.turbine.name,
            "inflow": simulator.inflow.description,
            "fidelity": simulator.fidelity.name,
            "aerodynamic_time_step_s": simulator.time_step,
            **attributes,
        }
        self._rows = []

    def __len__(self):
        return len(self._rows)

    def append(self, signals):
        """Store one instant."""
        self._rows.append(signals.values.copy())

    def clear(self):
        """Forget everything stored."""
        self._rows.clear()

    def to_dataset(self):
        """Data set with one variable a channel over ``time``; units, description and OpenFAST name as attributes."""
        import xarray as xr  # heavy, and only needed here

        table = np.array(self._rows).reshape(-1, len(self.channels))
        time = table[:, 0]
        variables = {}
        for k, channel in enumerate(self.channels[1:], start=1):
            attributes = {"units": channel.unit, "long_name": channel.description, "openfast_name": channel.openfast}
            variables[channel.name] = ("time", table[:, k], attributes)
        return xr.Dataset(variables, {"time": ("time", time, {"units": "s"})}, self.attributes)

    def save(self, path):
        """Write the data set as NetCDF 4; the file is there when it is whole."""
        write_netcdf_whole(Path(path), self.to_dataset())
