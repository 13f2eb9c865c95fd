"""Conversion of the MLD authors' checkpoints to model folders; quirks of their files live here."""
