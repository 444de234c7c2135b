"""Imported first by whatever imports DOLFINx, PETSc or SLEPc, which start PETSc by themselves."""

from brake_fenicsx.libraries import start_petsc

start_petsc()
