"""Options that several experiments share. Imports nothing heavy: the commands show them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.base.options import Options, option, option_record

if TYPE_CHECKING:
    from wt_gym.analysis.statistics import WindClimate
    from wt_gym.turbines import Turbine

__all__ = ["ClimateOptions"]


@option_record
class ClimateOptions(Options):
    """Wind climate that weighs loads over a life; it changes no run."""

    title = "climate"

    iec_class: str | None = option(
        "class of IEC 61400-1", default=None, choices=("I", "II", "III"), otherwise="the turbine's"
    )
    mean_wind_speed: float | None = option(
        "annual mean at hub height in place of that of the class", default=None, unit="m/s", low=0.0, above=True
    )
    weibull_shape: float = option("Weibull exponent", default=2.0, low=0.0, above=True)

    def of(self, turbine: Turbine) -> WindClimate | None:
        """Climate of a turbine; None where its class is none of the standard."""
        from wt_gym.analysis.statistics import WindClimate

        limits = {"shape": self.weibull_shape, "cut_in": turbine.cut_in, "cut_out": turbine.cut_out}
        if self.mean_wind_speed is not None:
            return WindClimate(self.mean_wind_speed, **limits)
        name = self.iec_class or turbine.iec_class
        return WindClimate.of_class(name, **limits) if name in ("I", "II", "III") else None
