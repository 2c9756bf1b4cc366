"""Work in separate processes with limits: solvers, certificates, and parts of a race on several cores."""
