"""Which candidate the records support: evidence, left-out blocks, and the rule that decides."""
