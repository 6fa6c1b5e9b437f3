"""What a world of the second clay is: a tool, a material, its faults, a scanner. Millimetres."""

from __future__ import annotations

from dataclasses import dataclass, fields

_NO_NAME = frozenset({"wide_when_damp", "deep_by_volts", "sinks_at_rest"})
_NAMES = {"stiff_when_cold": "stiffness_drift", "stiffens": "stiffness_drift"}


@dataclass(frozen=True)
class Effects:
    """How strong each fault is; 0: there is none. Each is named as the diagnosis should name it, or as described
    below."""

    height_offset: float = 0.0
    """Millimetres by which the tool goes lower than commanded."""
    tool_backlash: float = 0.0
    """Play of x, millimetres; y has three fifths of it."""
    springback: float = 0.0
    """Share of a dent that comes up again after a push without a rest."""
    volume_loss: float = 0.0
    """Share of what a push 6 mm deep displaces that is compressed instead."""
    slope_slide: float = 0.0
    """Degrees by which the steepest slope that stands is less steep than the tool's flank."""
    far_field: float = 0.0
    """Share of what is displaced that comes up far around."""
    work_hardening: float = 0.0
    """Share of its depth by which much worked clay holds the tool up."""
    adhesion_lift: float = 0.0
    """Millimetres by which clay is drawn up, per logarithm of the retract speed, under an 8 mm contact."""
    stiff_when_cold: float = 0.0
    """Share by which pushes go deeper where it is warm."""
    stiffens: float = 0.0
    """Share by which they become less deep as time goes by."""
    wide_when_damp: float = 0.0
    """Share by which the tool is wider for 12 % more humidity."""
    deep_by_volts: float = 0.0
    """Share by which pushes go deeper for 0.6 V more."""
    sinks_at_rest: float = 0.0
    """Millimetres by which the tool sinks per logarithm of its rest."""

    @property
    def there(self) -> frozenset[str]:
        """Those that are there."""
        return frozenset(field.name for field in fields(self) if getattr(self, field.name))


@dataclass(frozen=True)
class Clay:
    """A tool, a ball that goes over into a cone, and the material that it ploughs."""

    ball_mm: float = 8.0
    """Radius of the ball."""
    flank_deg: float = 66.0
    """Of the cone, above level."""
    spread_mm: float = 5.5
    """How far from the contact material is laid."""
    forward: float = 0.9
    """Share of it that a moving tool lays by where it is heading."""
    aside: float = 0.15
    """Share of that which goes to its sides and not ahead."""
    smooth_mm: float = 1.6
    """How far a worked surface closes up."""
    tear_mm: float = 0.07
    """Roughness that a push leaves."""
    noise_mm: float = 0.10
    """Of the scanner, from pixel to pixel."""
    patches_mm: float = 0.02
    """Of the scanner, from patch to patch."""
    deepest_mm: float = 8.0
    """Of the commands."""


@dataclass(frozen=True)
class World:
    """One world; what is not said here follows from its seed."""

    name: str
    seed: int
    clay: Clay
    effects: Effects = Effects()
    repeats_together: bool = False
    """Whether repeats of an action follow one another."""

    @property
    def truth(self) -> frozenset[str]:
        """What the finder should name."""
        return frozenset(_NAMES.get(name, name) for name in self.effects.there - _NO_NAME)
