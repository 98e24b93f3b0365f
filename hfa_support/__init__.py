"""What all packages share: errors, files, reports, jobs and native code."""
