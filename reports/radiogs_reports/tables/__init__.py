"""The tables of a run, made once from its summary: values as printed, verdicts, marks and sentences."""
