"""Links, ears and regions, the order in which they are worked on, and what is the same of them: kinds and constants."""
