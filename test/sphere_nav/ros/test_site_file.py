"""A site's parameter file is heard as a whole, or refused in one line that names what is not."""

from __future__ import annotations

from pathlib import Path

from sphere_nav.ros.compositions import RESTART_AFTER
from sphere_nav.ros.shared_files import share_file
from sphere_nav.ros.site_file import check_site_file

NODES = tuple(RESTART_AFTER)


def check(tmp_path: Path, text: str) -> str:
    """Return why a file of this text is refused, behind its name; empty where it is heard."""
    file = tmp_path / "site.yaml"
    file.write_text(text)
    try:
        check_site_file(str(file), NODES)
    except ValueError as error:
        where, _, reason = str(error).partition(f"{file}: ")
        assert not where
        return reason
    return ""


def test_what_nodes_declare_is_heard(tmp_path: Path) -> None:
    for text in [
        "/**: {ros__parameters: {vehicle: {wheelbase: 1.2}, map: campus}}",  # of several nodes
        "/**: {ros__parameters: {vehicle.wheelbase: 1.2, use_sim_time: true}}",
        "/**/path_follower: {ros__parameters: {speed: {cruise: 1.0}, qos_overrides: {/pose: {subscription: {}}}}}",
        "/**: {ros__parameters: {}}\n/**/mcl_depth: {ros__parameters: {preset: indoor}}",
    ]:
        assert check(tmp_path, text) == ""


def test_the_shipped_file_of_a_vehicle_is_heard(tmp_path: Path) -> None:
    text = share_file("config/cycab.yaml").read_text()
    assert check(tmp_path, text) == ""
    assert check(tmp_path, text.replace("speed_lag", "sped_lag")).startswith("/**: actuation.sped_lag (is")


def test_what_no_node_hears_is_refused(tmp_path: Path) -> None:
    for text, message in [
        ("/**: {ros__parameters: {spped: {cruise: 1.0}}}", "/**: spped.cruise (is speed.cruise meant?): expected a"),
        ("/**/command_guard: {ros__parameters: {speed: {cruise: 1.0}}}", "speed.cruise: expected a parameter of these"),
        ("/**/path_folower: {ros__parameters: {map: x}}", "/**/path_folower (is /**/path_follower meant?): expected"),
        ("path_follower: {ros__parameters: {map: x}}", "(is /**/path_follower meant?): expected /**, or /**/ and one"),
        ("/**: {map: x}", "/**.ros__parameters: expected a value, found none"),
        ("/**: 3", "/**: expected the fields ros__parameters, found 3"),
        ("/**: {ros__parameters: {map: a, map: b}}", "twice"),
    ]:
        reason = check(tmp_path, text)
        assert message in reason
        assert "\n" not in reason
