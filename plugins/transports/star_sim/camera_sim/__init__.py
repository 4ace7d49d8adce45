"""The camera of the simulator: pictures of AprilTags, or their corners without a picture.

Read in this order: `shot` (where the camera's carrier is and how it moves), `renderer` (`Renderer`:
a shot to an image) with its four steps `prisms`, `paper`, `floor` and `sensor`, `geometric`
(`Spotter`: a shot to the corners of tags), and `errors` (how the real tags and the real camera
differ from what a mission believes). Beneath lie `optics` (the lens), `motion` (poses during a
shot), `projection` and `plane` (from the map to the image and back) and `sheets` (tags as arrays).
"""
