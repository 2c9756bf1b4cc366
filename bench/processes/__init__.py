"""Work in separate processes with limits: solvers, certificates, the sentinel, and parts of a race on several
cores."""
