"""Method `difference`: the weighted difference form by errors-in-variables maximum likelihood."""
