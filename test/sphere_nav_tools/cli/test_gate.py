"""The gate before the pages: host, origin, token, guesses; over real sockets before a real viser."""

import argparse
import socket
import time
from http import HTTPStatus

import pytest

from sphere_nav_tools.cli import gate
from sphere_nav_tools.cli.constants import MAX_GUESSES, MAX_OUTSIDE
from sphere_nav_tools.cli.gate import Address, Gate, make_server, token_for

TOKEN = "a token of the yard"
LINK = "/a%20token%20of%20the%20yard"
HERE = "192.168.1.5"


class Headers(dict):
    def get_all(self, key):
        return [value for name, value in self.items() if name.strip() == key]


def judge(host="localhost:8081", guess=TOKEN, served="127.0.0.1", here="127.0.0.1", **more):
    headers = Headers({"Host": host} | {name.replace("_", "-"): value for name, value in more.items()})
    return Gate(served, TOKEN).judge(guess.encode(), headers, here, "127.0.0.1")


def test_this_machine_by_its_names_is_let_in_at_any_end_of_a_tunnel():
    for host in ["localhost:8081", "127.0.0.1:8081", "[::1]:8081", "LOCALHOST:9000", "localhost"]:
        assert judge(host) is None
        assert judge(host, Origin=f"http://{host.lower()}") is None


def test_another_name_that_leads_here_is_refused_with_the_right_token():
    for host in [
        *("evil.example:8081", "localhost.evil.example", "127.0.0.1.nip.io:8081", "192.168.1.5:8081", "0.0.0.0:8081"),
        *("", "localhost:8081:1", "evil@localhost:8081", "localhost/..", "127.0.0.1:", "2130706433:8081"),
    ]:
        assert judge(host)[1].startswith("Host: ")


def test_in_a_network_the_address_that_was_reached_and_the_name_of_the_machine_are_its_own(monkeypatch):
    for served in ["0.0.0.0", "::", HERE, "vehicle"]:
        monkeypatch.setattr(socket, "gethostname", lambda: "Car7")
        for host in (f"{HERE}:8081", "car7:8081", "car7.local:8081", "localhost:8081"):
            assert judge(host, served=served, here=HERE) is None, host
        assert judge("[fe80::1]:8081", served=served, here="fe80::1%eth0") is None
        for host in ("192.168.1.6:8081", "car8:8081", "0.0.0.0:8081"):
            assert judge(host, served=served, here=HERE) is not None, host


def test_another_page_is_refused_with_the_right_token_also_where_it_names_no_origin():
    for origin in [
        *("http://evil.example", "http://localhost:9999", "http://localhost", "http://127.0.0.1:8081", "null", ""),
        *("ftp://localhost:8081", "http://localhost:8081.evil.example", "http://localhost:8081/x"),
    ]:
        assert judge("localhost:8081", Origin=origin)[1].startswith("Origin: ")
    for site, is_in in (("none", True), ("same-origin", True), ("same-site", False), ("cross-site", False)):
        assert (judge(Sec_Fetch_Site=site, Sec_Fetch_Dest="image") is None) == is_in
        assert judge(Sec_Fetch_Site=site, Sec_Fetch_Dest="document") is None  # a link in a mail


def test_only_the_token_lets_in():
    for guess in ("", "a token of the yarn", TOKEN[:-1], TOKEN + "s", TOKEN.upper()):
        status, text = judge(guess=guess)
        assert (status, text[:24]) == (HTTPStatus.FORBIDDEN, "This page needs its toke")


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(gate.time, "monotonic", lambda: now[0])
    return now


def guesser(doors):
    def guess(word, visitor="10.0.0.9"):
        refusal = doors.judge(word.encode(), Headers({"Host": "localhost"}), "127.0.0.1", visitor)
        return None if refusal is None else refusal[0]

    return guess


def test_guesses_are_limited_for_who_guesses_and_for_nobody_else(clock):
    guess = guesser(Gate("127.0.0.1", TOKEN))
    found = [guess(f"guess {k}") for k in range(100)]
    assert found[:MAX_GUESSES] == [HTTPStatus.FORBIDDEN] * MAX_GUESSES
    assert set(found[MAX_GUESSES:]) == {HTTPStatus.TOO_MANY_REQUESTS}
    assert guess(TOKEN) == HTTPStatus.TOO_MANY_REQUESTS  # he must not learn that he has found it
    assert guess(TOKEN, "10.0.0.8") is None
    clock[0] += 1.0
    assert guess(TOKEN) is None
    assert guess("guess 100") == HTTPStatus.FORBIDDEN
    assert guess("guess 101") == HTTPStatus.TOO_MANY_REQUESTS
    clock[0] += 1000.0
    assert [guess(f"later {k}") for k in range(20)].count(HTTPStatus.FORBIDDEN) == MAX_GUESSES


def test_an_old_page_that_reconnects_shuts_nobody_out(clock):
    guess = guesser(Gate("127.0.0.1", TOKEN))
    assert {guess("the token of yesterday") for _ in range(1000)} == {HTTPStatus.FORBIDDEN}
    assert {guess("") for _ in range(1000)} == {HTTPStatus.FORBIDDEN}  # nothing is guessed
    assert guess(TOKEN) is None


def test_a_token_is_the_given_one_or_one_that_nobody_guesses(monkeypatch):
    monkeypatch.delenv(gate.TOKEN_VARIABLE, raising=False)
    first, second = token_for(""), token_for("")
    assert first != second
    assert min(len(first), len(second)) >= 20
    monkeypatch.setenv(gate.TOKEN_VARIABLE, "of the environment")
    assert (token_for(""), token_for("a long one")) == ("of the environment", "a long one")
    with pytest.raises(ValueError, match="--token: expected 8 characters or more, found 5"):
        token_for("short")


def test_a_printed_link_leads_to_the_machine(monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "car7")
    for host, token, link in [
        ("127.0.0.1", TOKEN, f"http://127.0.0.1:8082{LINK}"),
        ("0.0.0.0", "t/?#", "http://car7:8082/t%2F%3F%23"),
        ("::1", "t", "http://[::1]:8082/t"),
    ]:
        assert Address("operate", host, 8081, token).link(8082) == link


# --- before a real viser


@pytest.fixture(scope="module")
def served():
    pytest.importorskip("viser", reason="optional: pip install viser")
    server = make_server(Address("operate", "127.0.0.1", 8990, TOKEN))
    server.gui.add_button("start")
    yield server
    server.stop()


def ask(served, path=LINK, host=None, *lines):
    port = served.get_port()
    with socket.create_connection(("127.0.0.1", port), timeout=60.0) as line:
        head = [f"GET {path} HTTP/1.1", f"Host: {host or f'127.0.0.1:{port}'}", *lines, "", ""]
        line.sendall("\r\n".join(head).encode())
        answer = b"".join(iter(lambda: line.recv(1 << 16), b""))
    return int(answer.split()[1]), answer.partition(b"\r\n\r\n")[2]


def upgrade(served, origin):
    return ask(
        served,
        LINK,
        None,
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        f"Origin: {origin}",
    )[0]


def test_page_and_socket_are_served_to_who_has_the_token(served):
    websockets = pytest.importorskip("websockets.sync.client")
    import viser

    status, body = ask(served)
    assert (status, len(body) > 100_000) == (200, True)
    assert ask(served, f"{LINK}/?websocket=ws://x")[0] == 200
    assert ask(served, f"{LINK}/none.js")[0] == 404
    port = served.get_port()
    words = {"subprotocols": [f"viser-v{viser.__version__}"], "origin": f"http://127.0.0.1:{port}"}
    with websockets.connect(f"ws://127.0.0.1:{port}{LINK}", **words) as page:
        assert page.recv(timeout=60.0)


def test_all_else_is_refused_before_the_handshake(served):
    for path in ("/", "/index.html", "/wrong", "//", f"/x{LINK}", f"/..{LINK}", "/?token=" + LINK[1:]):
        assert ask(served, path)[0] in (403, 429), path
    assert ask(served, LINK, "evil.example:8990") == (403, b"Host: not a name of this page: use the printed link.\n")
    assert ask(served, LINK, None, "Host: evil.example")[0] == 403
    assert ask(served, LINK, None, "Origin: http://127.0.0.1:9999")[0] == 403
    assert {upgrade(served, origin) for origin in ("http://evil.example", "http://localhost:8990", "null")} == {403}
    assert not served.get_clients()


def test_connections_that_say_nothing_shut_nobody_out(served):
    idle = [socket.create_connection(("127.0.0.1", served.get_port())) for _ in range(3 * MAX_OUTSIDE)]
    try:
        assert ask(served)[0] == 200
        time.sleep(0.2)
        is_ended = []
        for line in idle:
            line.settimeout(0.0)
            try:
                is_ended.append(line.recv(1) == b"")
            except BlockingIOError:
                is_ended.append(False)
            except OSError:
                is_ended.append(True)
        assert sum(is_ended) >= 2 * MAX_OUTSIDE - 1
        assert is_ended[0]  # the oldest goes first
        assert not is_ended[-1]
    finally:
        for line in idle:
            line.close()


def test_a_viser_that_asks_no_gate_is_not_served(monkeypatch):
    viser = pytest.importorskip("viser")

    class Open:
        def __init__(self, *_, **__):
            pass

        def stop(self):
            ends.append(self)

    ends = []
    monkeypatch.setattr(viser, "ViserServer", Open)
    with pytest.raises(ValueError, match="operate: expected a viser that websockets serves"):
        make_server(Address("operate", "127.0.0.1", 8991, TOKEN))
    assert len(ends) == 1


def address(*words):
    parser = argparse.ArgumentParser()
    gate.add_options(parser, "view")
    return gate.address_of("view", parser.parse_args(words))


def test_a_port_that_is_named_is_served_or_refused_before_anything_starts():
    """Only the usual one may give way to the next."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for words in (("--port", port), ("--port", "99999"), ("--port", "-1"), ("--host", "300.1.1.1")):
            with pytest.raises(ValueError, match=f"{words[1]}: expected an address of this machine and a free port"):
                address(*words)
    assert (address("--port", port).port, address().port) == (int(port), 8080)
