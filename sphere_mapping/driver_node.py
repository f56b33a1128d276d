"""What a camera's driver decides for the mapper."""

from __future__ import annotations

from dataclasses import replace

from node_kit.drivers import read_driver
from sphere_mapping.intake_node import TOPICS
from sphere_mapping.params import SphereMapperParams


def with_driver_input(params: SphereMapperParams) -> SphereMapperParams:
    """Return the parameters with the input that the driver gives; ValueError for a driver without range."""
    if not params.driver or params.input != "sphere":
        return params
    driver = read_driver(params.driver)
    if driver.input not in TOPICS:
        raise ValueError(f"driver: expected one with depth or two cameras, found {driver.name}: {driver.title}")
    return replace(params, input=driver.input)
