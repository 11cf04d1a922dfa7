"""The scattering models of the package: each file is one, and is found by being here."""
