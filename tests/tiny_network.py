"""A network whose arithmetic costs next to nothing, for runs in which something else is under test.

Where it is put into `LAYERS`, as in every program that is `forked`, it takes the place of "nips".
"""

from common.network import Layers

TINY = Layers(((16, 12, 12),), 64)
"""A pixel of its only convolution is a cell of Catch."""
