"""A site's parameter file is heard as a whole, or refused in one line that names what is not."""

from __future__ import annotations

from pathlib import Path

from sphere_nav.ros.compositions import RESTART_AFTER
from sphere_nav.ros.shared_files import share_file
from sphere_nav.ros.site_file import check_site_file

NODES = tuple(RESTART_AFTER)


def check(tmp_path: Path, text: str, *started: str) -> str:
    """Return why a file of this text is refused, behind its name; empty where it is heard."""
    file = tmp_path / "site.yaml"
    file.write_text(text)
    try:
        check_site_file(str(file), NODES, started or ("//path_follower",))
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
        "path_follower: {ros__parameters: {autostart: false}}",
        "/car2: {path_follower: {ros__parameters: {autostart: false}}}",
        "/*/path_follower: {ros__parameters: {autostart: false}}\n/**: {ros__parameters: {}}",
        "/car3/mcl_depth: {ros__parameters: {preset: indoor}}",  # does not start now
    ]:
        started = "/car2/path_follower" if "/car2" in text or "/*/" in text else "//path_follower"
        assert check(tmp_path, text, started) == ""


def test_the_shipped_file_of_a_vehicle_is_heard(tmp_path: Path) -> None:
    text, started = share_file("config/cycab.yaml").read_text(), ("//path_follower", "//cycab_sim")
    assert check(tmp_path, text, *started) == ""
    assert check(tmp_path, text.replace("speed_lag", "sped_lag"), *started).startswith("/**: actuation.sped_lag (is")


def test_what_no_node_hears_is_refused(tmp_path: Path) -> None:
    for text, message in [
        ("/**: {ros__parameters: {spped: {cruise: 1.0}}}", "/**: spped.cruise (is speed.cruise meant?): expected a"),
        ("/**/command_guard: {ros__parameters: {speed: {cruise: 1.0}}}", "speed.cruise: expected a parameter of comm"),
        ("/**/path_folower: {ros__parameters: {map: x}}", "/**/path_folower (is path_follower meant?): expected /**"),
        ("/**: {map: x}", "/**/map: expected ros__parameters below it, found str"),
        ("/**: {ros__parameters: {map: a, map: b}}", "twice"),
    ]:
        reason = check(tmp_path, text)
        assert message in reason
        assert "\n" not in reason


def test_a_section_must_reach_the_node_in_its_namespace(tmp_path: Path) -> None:
    for section in ["path_follower", "/car3/path_follower", "/*/*/path_follower"]:
        text = f"{section}: {{ros__parameters: {{autostart: true}}}}"
        message = "expected a name for /car2/path_follower, such as /**/path_foll"
        assert message in check(tmp_path, text, "/car2/path_follower")
