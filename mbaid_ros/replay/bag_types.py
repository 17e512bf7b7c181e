"""The message classes of bags, for what makes messages without a graph."""

from __future__ import annotations

import numpy as np

from mbaid_ros.bags import message_class
from mbaid_ros.outgoing import MessageTypes

BAG_TYPES = MessageTypes(find=message_class, flags=np.asarray)
