"""The aircraft for every package: the declaration of a model, its loading and conversion."""
