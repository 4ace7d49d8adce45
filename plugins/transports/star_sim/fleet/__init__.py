"""Simulated Crazyflies that speak CRTP over UDP, as the firmware does, for any client of it.

``star fleet mission.yaml`` serves the drones of a mission; `star_sim.fleet.server.Fleet` does it in
a test. What a vehicle answers to a packet is in `star_sim.fleet.vehicle`, without any socket.
Names, types, formats and times are those of the Crazyflie firmware, protocol version 12.
"""
