"""Contact elements and laws in place of those of a brake."""

from types import SimpleNamespace

import numpy as np


def at_contact(contact):
    """What gives the brake of a sample, of which there is no more than these elements."""

    def at(values):
        reference = SimpleNamespace(contact=contact, at=at)
        return SimpleNamespace(values=values, contact=contact, reference=reference)

    return at


class ManyLinear:
    """A linear law of its own for every element, of a stiffness [Pa/m]."""

    def __init__(self, k):
        self.k = k

    def __len__(self):
        return self.k.size

    def first_touch(self, index):
        return np.zeros(np.shape(index))

    def loading(self, index, d):
        return self.k[index] * np.maximum(-d, 0), np.where(d < 0, self.k[index], 0.0)

    def vibration(self, index, d):
        return self.loading(index, d)[1], np.zeros(np.shape(index))
