"""Tuning of a preset's parameters on sequences with ground truth: the command `tune`.

1. Optuna searches the values that give the largest mean success AUC on some sequences.
2. Values that bring no more than the seeds' noise return to those of the preset.
3. Both are repeated with each group of sequences left out. What the values found on the others
   bring on the group left out estimates what tuning brings on footage that it has not seen.
4. The values found on all sequences are written if that gain is significant, otherwise the preset.

Source: nested cross-validation, Cawley and Talbot 2010, "On over-fitting in model selection".
"""
