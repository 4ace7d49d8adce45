"""Simulated cameras: images of AprilTags, or their corners without images.

Read in this order: `cameras` (exposure and arrival of images), `renderer` (an image, by kernels of
`obstacle_rasterizer`, `tag_rasterizer`, `floor_texture` and `sensor`), `geometric` (corners of tags
without an image), and `ground_truth` (true tags and cameras, which differ from those of a mission).
They share `camera_pose` (the lens, and poses during an exposure) and `projection` (from the map to
the image and back).
"""
