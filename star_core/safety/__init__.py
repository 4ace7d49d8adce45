"""What holds whatever plugins command: the safety filter, safety rules, monitors."""
