"""Parameters of the simulator, each with meaning, unit and range."""

from __future__ import annotations

from typed_params import group, param, parameters


@parameters
class LightParams:
    """Sun and exposure."""

    sun_azimuth_deg: float = param(238.0, "direction to the sun, counter-clockwise from the x axis", "deg")
    sun_elevation_deg: float = param(43.0, "height of the sun above the horizon", "deg", low=3.0, high=90.0)
    has_shadows: bool = param(True, "whether things cast shadows")
    exposure: float = param(0.85, "factor from radiance to the range of the grey levels", low=0.0)
    gamma: float = param(2.2, "grey level = 255 radiance^(1/gamma)", low=0.2, high=5.0)


@parameters
class RenderParams:
    """Effort spent on an image."""

    supersampling: int = param(2, "n x n rays for pixels where surfaces meet; 1: none", low=1, high=8)
    num_threads: int = param(0, "threads that share an image; 0: one a core", low=0)
    shadow_texel: float = param(0.08, "resolution of the shadows", "m", low=0.01)
    shadow_extent: float = param(160.0, "size of the square around the town's middle with shadows", "m", low=1.0)
