"""What both localisers share, without ROS.

`status.py` has the words (states, reasons, findings), `input_check.py` says which images are worth a look,
`state_machine.py` when a pose may be trusted, `params.py` the parameters of all that; the shell is in `sphere_nav.ros`.
"""

from sphere_nav.localization.input_check import InputCheck
from sphere_nav.localization.state_machine import StateMachine
from sphere_nav.localization.status import FINE, Reason, State, Status, Verdict

__all__ = ["FINE", "InputCheck", "Reason", "State", "StateMachine", "Status", "Verdict"]
