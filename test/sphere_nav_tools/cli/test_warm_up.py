"""The kernels of all packages are compiled by one command."""

from functools import partial

import pytest

from sphere_nav_tools.cli import warm_up


def test_a_package_whose_kernels_do_not_compile_is_not_passed_over(monkeypatch):
    monkeypatch.setattr(warm_up, "PARTS", (partial(float, "none"),))
    with pytest.raises(ValueError, match="none"):
        warm_up.main()
