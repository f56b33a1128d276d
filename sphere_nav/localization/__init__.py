"""What both localisers share, without ROS.

`status.py` has the words (states, reasons, findings) and says when a pose may be trusted, `input_check.py` which images
are worth a look, `params.py` the parameters of all that; the shell is in `sphere_nav.ros`.
"""

from sphere_nav.localization.input_check import InputCheck
from sphere_nav.localization.status import FINE, Reason, State, StateMachine, Status, Verdict, status_of

__all__ = ["FINE", "InputCheck", "Reason", "State", "StateMachine", "Status", "Verdict", "status_of"]
