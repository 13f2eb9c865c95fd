"""The MLD authors' checkpoints become our model folders; all quirks of their files live here."""
