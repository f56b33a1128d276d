"""The kernels of all packages are compiled by one command."""

from photometric.descent import kernels as descent
from sphere_mapping.acquisition import kernels as acquisition
from sphere_nav_cli import warm_up


def test_the_command_compiles_kernels_of_every_package_that_a_vehicle_runs():
    assert warm_up.main() == 0
    for kernel in (descent.descend, acquisition.smooth):
        assert kernel.signatures
