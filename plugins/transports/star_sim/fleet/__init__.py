"""Simulated Crazyflies that speak the firmware's CRTP over UDP, for any client.

``star fleet mission.yaml`` serves the drones of a mission; `star_sim.fleet.server.Fleet` does so in
a test. `star_sim.fleet.vehicle` implements the answers of a vehicle, without sockets.
Names, types, formats and times are those of the Crazyflie firmware, protocol version 12.
"""
