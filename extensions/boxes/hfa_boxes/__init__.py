"""Inequalities on sets, proved by branch and bound over boxes: regions of networks, costs."""
