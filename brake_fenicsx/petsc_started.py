"""Imported first by whatever imports DOLFINx, PETSc or SLEPc, which start PETSc by themselves."""

from brake_fenicsx.petsc import start_petsc

start_petsc()
