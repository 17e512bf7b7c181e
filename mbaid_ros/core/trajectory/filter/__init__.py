"""The square-root information filter, one belief a hypothesis."""
