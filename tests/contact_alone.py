"""Contact elements in place of a brake, for tests of what is drawn for them."""

from types import SimpleNamespace


def at_contact(contact):
    """What gives the brake of a sample, of which there is no more than these elements."""
    scene = SimpleNamespace(contact=contact)
    return lambda values: SimpleNamespace(values=values, contact=contact, reference=scene)
