"""Bodies whose stiffness changes from sample to sample, seen from their contact elements."""
