#!/usr/bin/env bash
# FElupe 11.3.0 and Elasticipy 7.0.0: the constants of an orthotropic lining.
#
# Guess: three moduli, three Poisson's ratios, three shear moduli come as in an Abaqus deck: nu 12, 13, 23, G 12, 13, 23,
#   the first index being that of the load.
# Behaviour: FElupe counts round: nu 12, 23, 31 and G 12, 23, 31. With a lining of E = 10, 5, 2 GPa and nu 12, 13, 23 =
#   0.3, 0.25, 0.2 typed in the order of the deck, 0.25 acts as nu 23 and 0.2 as nu 31, and the shear moduli of 13 and 23
#   change places. nu 31 is not nu 13 either: nu 13 = nu 31 E1 / E3, five times as large here.
#   Elasticipy asks for nu_xy or nu_yx by name, with the same first index as Abaqus, and gives the compliances that were meant.
# Why the guess fails: both orders have three numbers between 0 and 0.5 and a positive definite tensor.
#
# Output seen (compliance of 1 against 3, -nu13 / E1, in 1/GPa):
#   meant -0.025, Elasticipy -0.025, FElupe in the deck's order -0.100, FElupe with 12, 23, 31 -0.025
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet felupe==11.3.0 elasticipy==7.0.0 numpy==2.4.6 scipy==1.17.1
export MPLBACKEND=Agg MPLCONFIGDIR="$folder"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
from elasticipy.tensors.elasticity import StiffnessTensor
from felupe import LinearElasticOrthotropic

E1, E2, E3 = E = [10.0, 5.0, 2.0]
nu12, nu13, nu23 = 0.3, 0.25, 0.2
G12, G13, G23 = 3.0, 2.0, 1.0


def compliance(C):
    return np.linalg.inv(C)[0, 2]


def felupe(nu, G):
    hessian = LinearElasticOrthotropic(E=E, nu=nu, G=G).hessian([np.eye(3)[:, :, None, None], None])
    A = hessian[0][..., 0, 0]
    return compliance(np.array([[A[i, i, j, j] for j in range(3)] for i in range(3)])), A[1, 2, 1, 2]


T = StiffnessTensor.orthotropic(
    Ex=E1, Ey=E2, Ez=E3, nu_xy=nu12, nu_xz=nu13, nu_yz=nu23, Gxy=G12, Gxz=G13, Gyz=G23
)
named = compliance(T.matrix()[:3, :3])
as_deck, G23_as_deck = felupe([nu12, nu13, nu23], [G12, G13, G23])
round_about, G23_round = felupe([nu12, nu23, nu13 * E3 / E1], [G12, G23, G13])
print(
    f"meant {-nu13 / E1:.3f}, Elasticipy {named:.3f}, FElupe in the deck's order {as_deck:.3f}, "
    f"FElupe with 12, 23, 31 {round_about:.3f}"
)
assert np.allclose([named, round_about, as_deck], [-0.025, -0.025, -0.1])
assert np.allclose([G23_as_deck, G23_round], [G13, G23])
PY
