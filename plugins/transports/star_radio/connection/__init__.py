"""Connection to one Crazyflie: its link, questions and answers, tables, reports and estimator."""
