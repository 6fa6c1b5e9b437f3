"""Which stroke model to choose for a brush: the comparison of the thesis's chapter 5 (Table 5.2, Figure 4.8)."""
