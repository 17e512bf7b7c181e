"""The paper's two forms, corrected, and recursive least squares."""
