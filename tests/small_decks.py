"""Small decks written for the tests: a block of 4 C3D8 on a plate of 6, in mm, t and s.

The block, 40 x 20 x 20 mm, stands on the middle of the plate, 60 x 30 x 10 mm; all of its nodes and
elements are numbered from 1, those of the plate from 101.
"""


def _grid(first, x, y, z):
    """Lines of nodes and of elements of a box of hexahedra."""
    number = {(i, j, k): first + i + len(x) * (j + len(y) * k)
              for k in range(len(z)) for j in range(len(y)) for i in range(len(x))}  # fmt: skip
    nodes = [f"{n}, {x[i]}, {y[j]}, {z[k]}" for (i, j, k), n in number.items()]
    cells = []
    for j in range(len(y) - 1):
        for i in range(len(x) - 1):
            low, high = ([number[i + a, j + b, k] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
                         for k in (0, 1))  # fmt: skip
            cells.append(f"{first + len(cells)}, " + ", ".join(map(str, (*low, *high))))
    return nodes, cells


BLOCK = _grid(1, (10, 30, 50), (5, 15, 25), (0, 20))
PLATE = _grid(101, (0, 20, 40, 60), (0, 15, 30), (-10, 0))
MESH = "\n".join([
    "*HEADING", "block on plate", "*NODE", *BLOCK[0], *PLATE[0],
    "*ELEMENT, TYPE=C3D8, ELSET=BLOCK", *BLOCK[1], "*ELEMENT, TYPE=C3D8, ELSET=PLATE", *PLATE[1],
    "*NSET, NSET=TOP", "10, 11, 12, 13, 14, 15, 16, 17, 18",
    "*NSET, NSET=BOTTOM", *(f"{n}," for n in range(101, 113)),
    "*NSET, NSET=SIDE", "3, 6, 9, 12, 15, 18",
    "*SURFACE, NAME=PAD", "BLOCK, S1", "*SURFACE, NAME=DISC", "PLATE, S2",
    "*SURFACE, NAME=BACK", "BLOCK, S2", "",
])  # fmt: skip
MATERIALS = """*MATERIAL, NAME=LINING
*ELASTIC
2000., 0.3
*DENSITY
2.5e-9
*MATERIAL, NAME=IRON
*ELASTIC
125000., 0.24
*DENSITY
7.2e-9
*SOLID SECTION, ELSET=BLOCK, MATERIAL=LINING
*SOLID SECTION, ELSET=PLATE, MATERIAL=IRON
"""
INTERACTION = """*SURFACE INTERACTION, NAME=RUBS
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
2.E4
*FRICTION
0.4
"""
PAIR = "*CONTACT PAIR, INTERACTION=RUBS, TYPE=SURFACE TO SURFACE\nPAD, DISC\n"
HELD = "*BOUNDARY\nBOTTOM, 1, 3\nTOP, 1, 2\n"
PRESSED = "*STEP\n*STATIC\n*DSLOAD\nBACK, P, 0.5\n*END STEP\n"
MODES = "*STEP\n*COMPLEX FREQUENCY\n10, , 12000.\n*END STEP\n"


def deck(**parts):
    """A deck; each part may be replaced by another text, and "before" and "after" be added."""
    order = {
        "mesh": MESH, "materials": MATERIALS, "interaction": INTERACTION, "before": "",
        "pair": PAIR, "held": HELD, "pressed": PRESSED, "after": "", "modes": MODES,
    }  # fmt: skip
    assert parts.keys() <= order.keys()
    return "".join((order | parts).values())
