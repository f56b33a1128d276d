"""The world that everything is tested in: a town, cameras that look at it, a car that drives through it.

READ FIRST `simulator.py`. The town is drawn from a seed (`town.py`, `building.py`, `street.py`, `furniture.py` build
a `Mesh`; `texture/` gives it detail), `renderer.py` casts rays into it for any camera of sphere_nav.geometry,
`traffic/` moves all others, `sky.py` changes the light, `sensors/` measure, `vehicle.py` moves the car, `cameras.py`
says what is mounted on it, `driver.py` drives the taught path.
"""

from cycab_sim.world.worlds import geometry_cloud

__all__ = ["geometry_cloud"]
