"""What `train.babbling` needs: postures at random, ways of learning a body, scores, a figure."""
