"""What several tests share: scenes by formula, independent truths, and doors to other programs."""
