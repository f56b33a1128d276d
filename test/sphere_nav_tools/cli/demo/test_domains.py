"""No two drives, and no drive and test, hear each other."""

import os
import subprocess
import sys

import pytest

from sphere_nav_tools.cli.demo.domains import FOR_DRIVES, FOR_TESTS, claim_domain

CLAIM = """
import sys
from sphere_nav_tools.cli.demo.domains import claim_domain
print(claim_domain(range(200, 202)), flush=True)
sys.stdin.read()
"""


def test_a_drive_and_a_test_never_share_a_domain():
    assert not set(FOR_DRIVES) & set(FOR_TESTS)
    assert {0} < {0, *FOR_DRIVES, *FOR_TESTS} == set(range(100))
    assert int(os.environ["ROS_DOMAIN_ID"]) in FOR_TESTS


def test_a_process_claims_each_domain_once():
    assert {claim_domain(range(210, 212)), claim_domain(range(210, 212))} == {210, 211}
    with pytest.raises(RuntimeError, match=r"expected one of range\(210, 212\) that is free, found all in use"):
        claim_domain(range(210, 212))


@pytest.mark.dds
def test_two_processes_drive_in_two_domains_and_leave_them_free(tmp_path):
    children = [
        subprocess.Popen([sys.executable, "-c", CLAIM], stdin=subprocess.PIPE, stdout=subprocess.PIPE) for _ in "ab"
    ]
    assert {int(child.stdout.readline()) for child in children} == {200, 201}
    for child in children:
        child.communicate()
    assert claim_domain(range(200, 202)) == 200
