"""A result as one document, for four renderers; and what goes to the controller."""
