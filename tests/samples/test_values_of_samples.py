"""A sample with a value is the scene with that value: every kind of law, every key.

The block stands on a base of springs and under a tied cap, so that the force of the contact depends
on every stiffness. A library is the one kind of law that follows the modulus of the pad; and the
layer of a tie is written, since its default is that of the moduli of the scene.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brake_fenicsx import model
from brake_fenicsx.build.values import Values
from brake_fenicsx.samples.sampling import law_factor
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.samples_section import unit_of
from coarse_block import BLOCK
from full_order import agrees

E, NU, G = [6e9, 5e9, 2.3e9], [0.2, 0.35, 0.3], [1.2e9, 1.1e9, 2.4e9]


def quantity(value, unit):
    """A value of a scene."""
    return f"'{value!r} {unit}'" if unit else repr(value)


def quantities(values, unit="Pa"):
    """A list of them."""
    return f"[{', '.join(quantity(v, unit) for v in values)}]"


STAGES = "stages=['surface','micro','equilibrium','stability']"
SCENE = [
    STAGES, "surface.statistics={ S_q='1 um' }",
    "micro={ patch='10 mm', pixels=16, laws=3, E='2.3 GPa', nu=0.3 }",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'",
    'parts.cap={ builder="block", length="30 mm", width="20 mm", height="8 mm", z="20 mm",'
    ' size="20 mm", material="alloy" }',
    'ties={ cap={ faces=["block.top", "cap.bottom"], stiffness="1e16 Pa/m" } }',
    'supports={ "cap.top"=["x", "y"] }', 'loads={ "cap.top"={ pressure="5 bar" } }',
    "springs={ 'plate.bottom'={ stiffness=['80 kN/mm', '60 kN/mm', '150 kN/mm'] },"
    " 'cap.top'={ stiffness=['0 N/m', '0 N/m', '200 kN/mm'] } }",
    f"materials.lining={{ model='orthotropic', E={quantities(E)}, nu={NU}, G={quantities(G)},"
    " rho='2510 kg/m^3', loss=0.05 }",
    "materials.alloy={ model='transversely-isotropic', C11='90 GPa', C12='30 GPa', C13='30 GPa',"
    " C33='80 GPa', C44='25 GPa', rho='2700 kg/m^3' }",
    "stability.band=['0 Hz','12 kHz']", "stability.zeta_max=0.3", "stability.method=reduced",
    "samples.approaches=['multi-scale','classical']", "samples.classical.penalty='2e12 Pa/m'",
]  # fmt: skip
FRICTION = {
    "number": "contact.block_plate.friction=0.5",
    "falling": "contact.block_plate.friction={ static=0.6, kinetic=0.4, decay='2 m/s' }",
}
LAWS = {
    "library": "'library'", "linear": "{ linear='2e11 Pa/m' }",
    "exponential": "{ p0='10 MPa', u0='1 um' }",
    "table": "{ table='law.csv', units=['um', 'MPa'] }",
}  # fmt: skip


def listed(name, values, place, value):
    """Override of one of several values of the lining."""
    changed = [*values[:place], value, *values[place + 1 :]]
    return f"materials.lining.{name}={quantities(changed, '' if name == 'nu' else 'Pa')}"


NOMINAL = {
    "contact.block_plate.friction": 0.5, "loads.cap.top.pressure": 5e5, "motion.speed": 1.0,
    "samples.classical.penalty": 2e12, "stability.damping.rayleigh.alpha": 50.0,
    "stability.damping.rayleigh.beta": 2e-8, "materials.lining.loss": 0.05,
    "materials.lining.E_1": E[0], "materials.lining.E_3": E[2],
    "materials.lining.nu_31": NU[1] * E[2] / E[0], "materials.lining.nu_32": NU[2] * E[2] / E[1],
    "materials.lining.nu_12": NU[0], "materials.lining.G_13": G[1], "materials.lining.G_23": G[0],
    "materials.iron.E": 125e9, "materials.iron.nu": 0.24, "materials.alloy.C33": 8e10,
    "materials.alloy.C12": 3e10,
}  # fmt: skip


def unit(key):
    return "m/s" if key == "motion.speed" else unit_of(key)


def written(key, value):
    """Overrides of the scene that stand for a value."""
    constant = key.removeprefix("materials.lining.")
    if constant in ("E_1", "E_3"):
        # At fixed nu_12, nu_31 and nu_32.
        i, e = int(constant[-1]) - 1, [*E]
        e[i] = value
        nu = [NU[0], *(NU[j] * E[2] / E[j - 1] * e[j - 1] / e[2] for j in (1, 2))]
        return [listed("E", E, i, value), f"materials.lining.nu={nu}"]
    if constant in ("nu_31", "nu_32"):
        j = int(constant[-1])
        return [listed("nu", NU, j, value * E[j - 1] / E[2])]
    if constant in ("nu_12", "G_13", "G_23"):
        name, values, place = {"nu_12": ("nu", NU, 0), "G_13": ("G", G, 1), "G_23": ("G", G, 0)}[
            constant
        ]
        return [listed(name, values, place, value)]
    if constant.startswith("stability"):
        pair = {"alpha": 50.0, "beta": 2e-8, constant.rpartition(".")[2]: value}
        return [f"stability.damping.rayleigh=['{pair['alpha']!r} 1/s', '{pair['beta']!r} s']"]
    key = key.replace("cap.top", '"cap.top"')
    return [f"{key}={quantity(value, unit(key))}"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The scene beside a law in a table; laws and reduced models are made once."""
    folder = tmp_path_factory.mktemp("block")
    gaps = np.linspace(-1.0, 8.0, 19)
    rows = "\n".join(f"{g},{10 * np.exp(-g) / (1 + g * g / 50)}" for g in gaps)
    (folder / "law.csv").write_text(f"gap,pressure\n{rows}\n")
    (folder / "scene.toml").write_text(BLOCK.read_text())
    return folder


@pytest.mark.long
@settings(max_examples=3, deadline=None)
@given(
    law=st.sampled_from([*LAWS]), key=st.sampled_from([*NOMINAL]), factor=st.floats(0.8, 1.25),
    drawn=st.booleans(),
)  # fmt: skip
def test_sample_with_a_value_is_the_scene_with_it(folder, law, key, factor, drawn):
    """Contact force, and every mode within its stated error."""
    constant = key.endswith("friction")
    damping = "rayleigh=['50 1/s', '2e-8 s'], loss=true, omega_ref='6 kHz', sliding=true"
    base = [
        *SCENE, f"contact.block_plate.law={LAWS[law]}",
        FRICTION["number" if constant else "falling"],
        f"stability.damping={{ {damping}, slope={'false' if constant else 'true'} }}",
    ]  # fmt: skip
    approach = "classical" if "penalty" in key else "multi-scale"
    scene, cache, nominal = folder / "scene.toml", folder / "cache", NOMINAL[key]
    ends, values = sorted([nominal, nominal * factor]), {}
    if drawn and approach == "multi-scale":
        low, high = (quantity(end, unit(key)) for end in (ends[0], 1.001 * ends[1]))
        random = f"samples.random.\"{key}\"={{ law='uniform', min={low}, max={high} }}"
        stages = f"{STAGES[:-1]},'uncertainty']"
        prepared = model.prepare(scene, [*base, stages, random], cache=cache)
        value = prepared.study.sample((approach, 0)).values[key]
    else:
        prepared = model.prepare(scene, base, cache=cache, parameters={key: ends})
        value = nominal * factor
        values = {key: value}
    eq, found = prepared.equilibrium_and_modes(values, approach)
    more = written(key, value)
    if law == "library" and key.startswith("materials"):
        read = read_scene(scene, base)
        ratio = law_factor("block_plate", Values(read, {key: value}))
        more.append(f"micro.E={quantity(2.3e9 * ratio, 'Pa')}")
    whole = model.prepare(scene, [*base, *more], cache=cache)
    exact_eq, exact = whole.equilibrium_and_modes({}, approach)
    w = whole.study.brake.w
    np.testing.assert_allclose(w @ eq.p, w @ exact_eq.p, rtol=1e-6)
    agrees(found, exact)
