"""The table of archived variables: one line each, from which all else about the archive follows.

Allocation, the checks on writing and reading, the attributes in the file and the documentation
take names, dimensions, units and meaning from here.
"""

from dataclasses import dataclass

__all__ = ["COORDINATES", "VARIABLES", "Variable"]


@dataclass(frozen=True)
class Variable:
    """One variable of the archive.

    Names of species are labels beside their dimension, for CF's coordinate variables are numbers.
    """

    name: str
    dims: tuple[str, ...]
    units: str
    long_name: str
    dtype: str = "float64"
    optional: bool = False
    gaps: bool = False  # NaN where there is nothing to tell

    @property
    def attributes(self) -> dict[str, str]:
        """What is written beside the numbers."""
        if self.dtype == "str":
            return {"long_name": self.long_name}
        return {"long_name": self.long_name, "units": self.units}


COORDINATES = {
    coordinate.name: coordinate
    for coordinate in (
        Variable("time", ("time",), "s", "time since pouring began"),
        Variable("x", ("x",), "cm", "distance from the pouring point, or from a drum's middle"),
        Variable("z", ("z",), "cm", "height above the floor, or above a drum's lowest point"),
        Variable("species_name", ("species",), "", "species of grain", "str"),
        Variable(
            "surface_species_name",
            ("surface_species",),
            "",
            "species met on the surface",
            "str",
        ),
    )
}

VARIABLES = {
    variable.name: variable
    for variable in (
        Variable("height", ("time", "x"), "cm", "height of the static pile"),
        Variable(
            "rolling_thickness",
            ("time", "x", "species"),
            "cm",
            "equivalent thickness of rolling grains, those about to leave the cell downhill",
        ),
        Variable(
            "surface_fraction",
            ("time", "x", "species"),
            "1",
            "volume fraction at the surface of the pile",
        ),
        Variable(
            "deposit_fraction",
            ("z", "x", "species"),
            "1",
            "volume fraction in the deposit at the end of the pour",
            "float32",
            gaps=True,
        ),
        Variable("base_height", ("x",), "cm", "height of the surface before pouring"),
        Variable(
            "poured_volume",
            ("time", "species"),
            "cm2",
            "volume poured per unit gap, a drum's filling from the start",
        ),
        Variable("rolling_volume", ("time", "species"), "cm2", "volume rolling per unit gap"),
        Variable("deposited_volume", ("time", "species"), "cm2", "volume at rest per unit gap"),
        Variable(
            "outflow_volume",
            ("time", "species"),
            "cm2",
            "volume that fell off an open end per unit gap",
        ),
        Variable(
            "repose_slope",
            ("species", "surface_species"),
            "1",
            "repose slope of a rolling species on a surface of another",
        ),
        Variable(
            "collision_rate",
            ("species", "surface_species"),
            "s-1",
            "rate at which a rolling species converts grains of a surface species",
            optional=True,
        ),
        Variable("drift_velocity", ("species",), "cm s-1", "downhill speed of rolling grains"),
        Variable("grain_diameter", ("species",), "cm", "grain diameter"),
        Variable("inflow", ("species",), "cm", "mean rolling thickness fed at x = 0"),
    )
}
