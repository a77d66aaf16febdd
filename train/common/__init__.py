"""What every training script needs: run folders, logs, workers, videos."""
