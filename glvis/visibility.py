"""What counts as visible, and the maps that say which sensor sees which face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# What ``semantics = "paper"`` means for the other options (Sec. 2.1.1).
_PAPER: dict[str, Any] = {"criterion": "centroid", "incidence": "axis", "occlusion": "paper"}


@dataclass(frozen=True)
class VisibilityOptions:
    """Which faces count as seen.

    Attributes
    ----------
    criterion : str
        "pixels": the face shows in at least ``min_pixels`` pixels. "centroid": nothing hides
        its centre of mass, the paper's rule.
    min_pixels : int
        For "pixels".
    resolution : str or tuple of int
        Pixels of a render: "auto", "sensor" (its own) or (width, height).
    incidence : str
        Angle between the normal and the true "ray" or the optical "axis".
    occlusion : str
        "physical": refused faces still hide what lies behind them. "paper": faces refused by
        CropBack and CropNorm hide nothing.
    semantics : str
        "" or "paper": every choice of the paper at once; see ``paper``.
    """

    criterion: str = "pixels"
    min_pixels: int = 1
    resolution: str | tuple[int, int] = "auto"
    incidence: str = "ray"
    occlusion: str = "physical"
    semantics: str = ""

    def __post_init__(self) -> None:
        for name, allowed in _WORDS.items():
            if getattr(self, name) not in allowed:
                choice = " or ".join(f"'{word}'" for word in allowed)
                raise ValueError(f"{name} = '{getattr(self, name)}' must be {choice}")
        if self.min_pixels < 1:
            raise ValueError(f"min_pixels = {self.min_pixels} must be at least 1")
        if isinstance(self.resolution, str):
            if self.resolution not in ("auto", "sensor"):
                raise ValueError(
                    f"resolution = '{self.resolution}' must be 'auto', 'sensor' or [width, height]"
                )
        elif len(self.resolution) != 2 or min(self.resolution) < 1:
            raise ValueError(f"resolution = {list(self.resolution)} must be at least [1, 1]")
        if self.semantics == "paper":
            for name, meant in _PAPER.items():
                if getattr(self, name) != meant:
                    raise ValueError(
                        f"{name} = '{getattr(self, name)}' contradicts semantics = 'paper', "
                        f"which means '{meant}'"
                    )

    @classmethod
    def paper(cls, resolution: str | tuple[int, int] = "auto") -> VisibilityOptions:
        """Return the paper's choices: centroid, occlusion paper, incidence by the axis."""
        return cls(resolution=resolution, semantics="paper", **_PAPER)


_WORDS = {
    "criterion": ("pixels", "centroid"),
    "incidence": ("ray", "axis"),
    "occlusion": ("physical", "paper"),
    "semantics": ("", "paper"),
}
