"""The kernels of all packages are compiled by one command."""

from functools import partial

import pytest

from sphere_nav.kernel_cache.folder import PACKAGES, cache_folder
from sphere_nav_tools.cli import warm_up


@pytest.mark.slow
def test_the_command_compiles_kernels_of_every_package(capsys, monkeypatch):
    assert warm_up.main() == 0
    for package in PACKAGES:
        if package != "kernel_cache":  # has none of its own
            assert list(cache_folder(package).rglob("*.nbi")), package
    capsys.readouterr()
    monkeypatch.setattr(warm_up, "PARTS", warm_up.PARTS[2:3])  # the second time the quickest one is enough
    assert warm_up.main() == 0
    assert capsys.readouterr().err == ""  # nothing is announced where nothing is compiled


def test_a_package_whose_kernels_do_not_compile_is_not_passed_over(monkeypatch):
    monkeypatch.setattr(warm_up, "PARTS", (partial(float, "none"),))
    with pytest.raises(ValueError, match="none"):
        warm_up.main()
