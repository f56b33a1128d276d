"""What dresses the page: the stop by its id, no quotes that would end the attribute."""

from sphere_nav_tools.cli.operate.look import dressing


def test_the_stop_is_pinned_by_its_id_and_asked_for_apart():
    text = dressing("a-1")
    assert "#STOP" not in text
    assert "[id='a-1'] {position:fixed" in text
    script = text.split('onerror="')[1]
    assert script.count('"') == 1
    assert r"closest('[id=\'a-1\']')" in script
