"""All modes of a band at full order, and the proofs that none is missing."""
