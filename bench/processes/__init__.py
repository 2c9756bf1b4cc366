"""Work in processes of their own, with limits: solvers, proofs, the sentinel, and whole parts of a race on several
cores."""
