"""What dresses the page: a stop of the document's own, no quotes that would end the attribute."""

from sphere_nav_tools.cli.operate.look import dressing


def test_the_stop_belongs_to_the_document_and_asks_by_a_request_of_its_own():
    text = dressing()
    assert "#sn-stop {position:fixed" in text
    script = text.split('onerror="')[1]
    assert script.count('"') == 1
    assert "document.documentElement.appendChild" in script
    assert "fetch('/' + token + '/emergency_stop'" in script
