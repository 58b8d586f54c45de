"""The exact inverse of an identified handle as one causal filter, its prediction and its bound.

`design.design_inverse` makes the filter and `family.design_family` one for every grip,
`prediction.predict` gives its error, force and travel, and `bound.causal_bound` the smallest
error of any causal filter.
"""
