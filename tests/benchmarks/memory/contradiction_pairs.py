# ruff: noqa: E501 (one pair a line)
"""Pairs of lessons that contradict one another, and as many that only look so; all written by hand.

They were written before the detector was, and none was changed afterwards. Of each label every second pair is for
tuning the detector (words that were missing in its lexicons, thresholds), the others are held out: they are measured
and never looked into. ``!`` marks a contradiction, ``=`` none.
"""

from dataclasses import dataclass

_PAIRS = """
! robot | Lift the cup 15 cm above the table. | Lift the cup 5 cm above the table.
! robot | Raise the box by 150 mm before moving it. | Raise the box by 0.4 m before moving it.
! robot | Open the gripper before descending to the block. | Close the gripper before descending to the block.
! robot | Push the tray to the left. | Push the tray to the right.
! robot | Rotate the wrist clockwise to loosen the cap. | Rotate the wrist counterclockwise to loosen the cap.
! robot | Approach the mug from above. | Approach the mug from below.
! robot | Grasp the bottle by its neck. | Never grasp the bottle by its neck.
! robot | Use a standoff of 8 cm for the drawer handle. | Use a standoff of 2 cm for the drawer handle.
! robot | Tilt the wrist 30 degrees when grasping the plate. | Tilt the wrist by 75° when grasping the plate.
! robot | Move slowly near the glass. | Move quickly near the glass.
! robot | Keep the gripper force below 10 N for eggs. | Keep the gripper force above 20 N for eggs.
! robot | Hold the jar with the left hand. | Hold the jar with the right hand.
! robot | Wait at least 3 s after closing the fingers. | Wait at most 1 s after closing the fingers.
! robot | Pull the drawer open by its handle. | Push the drawer open by its handle.
! robot | Turn the arm toward the front of the shelf. | Turn the arm toward the back of the shelf.
! robot | Do not touch the lamp shade. | Touch the lamp shade to steady it.
! robot | Drive the base at 0.5 m/s in the corridor. | Drive the base at 2 m/s in the corridor.
! robot | Press the button to a depth of 3 mm. | Press the button to a depth of 1 cm.
! robot | Insert the peg vertically. | Insert the peg horizontally.
! robot | Place the lid on first, then fill the pot. | Fill the pot first, then place the lid on.
! robot | The camera must be calibrated before the arm moves. | The camera must be calibrated after the arm moves.
! robot | Keep the wrist level while carrying soup, within 5 degrees. | Keep the wrist tilted 20 to 30 degrees while carrying soup.
! robot | Slide the book forward until it meets the wall. | Slide the book backward until it meets the wall.
! robot | Increase the grasp depth for thin boxes. | Decrease the grasp depth for thin boxes.
! kitchen | Bake the bread at 220 °C. | Bake the bread at 160 °C.
! kitchen | Boil the eggs for 10 minutes. | Boil the eggs for 3 minutes.
! kitchen | Add 20 g of salt to the dough. | Add 5 g of salt to the dough.
! kitchen | Add the milk before the flour. | Add the milk after the flour.
! kitchen | Cook the rice with the lid closed. | Cook the rice with the lid open.
! kitchen | Always preheat the oven. | Never preheat the oven.
! kitchen | Stir the sauce continuously while it thickens. | Do not stir the sauce while it thickens.
! kitchen | Rinse the rice in cold water. | Rinse the rice in hot water.
! kitchen | Whisk the cream at high speed. | Whisk the cream at low speed.
! kitchen | Fill the kettle to 80 %. | Fill the kettle to 30 %.
! kitchen | Let the dough rest between 60 and 90 minutes. | Let the dough rest 10 minutes.
! kitchen | Serve the wine chilled, at 8 degrees. | Serve the wine at 22 degrees.
! kitchen | Cut the dough into pieces of 2 inches. | Cut the dough into pieces of 20 cm.
! kitchen | Remove the pan from the stove before adding butter. | Add butter, then remove the pan from the stove.
! shell | Run the installer as root with sudo. | Never run the installer as root with sudo.
! shell | Set the timeout to 30 seconds for the download. | Set the timeout to 500 ms for the download.
! shell | Enable the firewall on the build server. | Disable the firewall on the build server.
! shell | Start the daemon before running migrations. | Stop the daemon before running migrations.
! shell | Use port 8080 for the proxy. | Use port 9090 for the proxy.
! shell | Limit the container to 512 MB of memory. | Limit the container to 4 GB of memory.
! shell | Mount the volume before starting the container. | Unmount the volume before starting the container.
! shell | Sort the log in ascending order. | Sort the log in descending order.
! shell | Avoid piping curl into the shell for this setup. | Pipe curl into the shell for this setup.
! shell | Quote variables in the deploy script. | Don't quote variables in the deploy script.
! code | Indent the Makefile with tabs. | Indent the Makefile with spaces.
! code | Run the test suite in parallel. | Run the test suite sequentially.
! code | Commit the lock file. | Do not commit the lock file.
! code | Retry the request 3 times. | Retry the request 10 times.
! code | Set the cache flag to true in settings.py. | Set the cache flag to false in settings.py.
! code | Validate the input before parsing it. | Parse the input before validating it.
! code | Keep lines at most 80 characters long. | Keep lines at least 100 characters long.
! code | Add the import at the top of the module. | Add the import at the bottom of the module.
! code | Lock the mutex when reading the counter. | Unlock the mutex when reading the counter.
! code | Set the learning rate to 0.001 for fine-tuning. | Set the learning rate to 0.1 for fine-tuning.
! code | Allow null values in the email column. | Forbid null values in the email column.
! code | Include the vendor folder when linting. | Exclude the vendor folder when linting.
! home | Turn on the heating at night. | Turn off the heating at night.
! home | Leave the window open while painting. | Leave the window closed while painting.
! home | Tighten the screw before gluing. | Loosen the screw before gluing.
! home | Water the cactus every 14 days. | Water the cactus every 2 days.
! home | Set the thermostat between 18 and 20 degrees. | Set the thermostat between 24 and 26 degrees.
! german | Hebe die Tasse 15 cm an. | Hebe die Tasse 5 cm an.
! german | Drehe den Deckel nach links. | Drehe den Deckel nach rechts.
! german | Öffne den Greifer vor dem Absenken. | Schließe den Greifer vor dem Absenken.
! german | Drücke niemals auf den roten Knopf. | Drücke auf den roten Knopf.
! german | Den Motor vor der Messung einschalten. | Den Motor vor der Messung ausschalten.
! german | Backe den Kuchen höchstens 30 Minuten. | Backe den Kuchen mindestens 50 Minuten.
! german | Die Schraube im Uhrzeigersinn drehen. | Die Schraube gegen den Uhrzeigersinn drehen.
! french | Tournez la vis vers la gauche. | Tournez la vis vers la droite.
! french | Ouvrez la pince avant de descendre. | Fermez la pince avant de descendre.
! french | Soulevez la boîte de 20 cm. | Soulevez la boîte de 4 cm.
! french | Ne touchez jamais le verre chaud. | Touchez le verre chaud.
! spanish | Empuja la caja hacia la izquierda. | Empuja la caja hacia la derecha.
! spanish | Abre la puerta antes de entrar. | Cierra la puerta antes de entrar.
! spanish | Levanta el vaso 10 cm. | Levanta el vaso 30 cm.
! chinese | 向左推盒子。 | 向右推盒子。
! chinese | 先打开夹爪再下降。 | 先关闭夹爪再下降。
! chinese | 把杯子抬高15厘米。 | 把杯子抬高5厘米。
! chinese | 不要触碰灯罩。 | 触碰灯罩。
! chinese | 顺时针旋转瓶盖。 | 逆时针旋转瓶盖。
= robot | Lift the cup 15 cm above the table. | Lift the cup 150 mm above the table.
= robot | Lift the cup at least 5 cm. | Lift the cup 15 cm.
= robot | Do not forget to open the gripper before descending. | Open the gripper before descending.
= robot | Push the tray to the left. | Push the cup to the right.
= robot | Rotate the wrist clockwise to close the cap. | Rotate the wrist counterclockwise to open the cap.
= robot | Open the left drawer. | Open the right drawer.
= robot | Lift the mug 15 cm. | Lift the plate 5 cm.
= robot | Use a standoff of 8 cm for the drawer handle. | Use a standoff of 2 cm for the lamp button.
= robot | Tilt the wrist 30 degrees when grasping the plate. | Tilt the wrist by 0.52 rad when grasping the plate.
= robot | Never grasp the bottle by its cap. | Grasp the bottle by its neck.
= robot | Move slowly near the glass. | Move quickly in free space.
= robot | Keep the force below 10 N for eggs. | Keep the force below 12 N for eggs.
= robot | Push the block from the left, not from the right. | Push the block from the left.
= robot | Don't lift without closing the gripper. | Close the gripper, then lift.
= robot | Wait at least 3 s after closing the fingers. | Wait 5 s after closing the fingers.
= robot | Grasp depth 2 cm worked for the box. | Lift height 15 cm worked for the box.
= robot | Do not push the tall bottle. | Push the flat tray gently.
= robot | Open the gripper to 8 cm. | Close the gripper to 3 cm.
= robot | Approach the mug from above. | Approach the mug from the top.
= robot | Press the button to a depth of 3 mm. | Press the button for 1 s.
= robot | Move the block from left to right. | Push the block to the right.
= robot | Pick up a small box: this grasp depth succeeded. | Pick up a small box: this standoff succeeded.
= robot | Keep the wrist level. | Do not tilt the wrist.
= robot | Never move above 0.5 m/s near people. | Move at 0.2 m/s near people.
= robot | Waypoint 3 was 4 mm off. | Waypoint 7 was 9 mm off.
= robot | Close the gripper after reaching the block. | Open the gripper after reaching the goal.
= kitchen | Bake the bread at 220 °C. | Bake the biscuits at 160 °C.
= kitchen | Boil the eggs for 10 minutes. | Boil the eggs for 600 seconds.
= kitchen | Boil eggs for 10 minutes when they should be hard. | Boil eggs for 4 minutes when they should be soft.
= kitchen | Never leave the oil unattended. | Heat the oil slowly.
= kitchen | Add 20 g of salt to the dough. | Add 5 g of yeast to the dough.
= kitchen | Add the milk before the flour. | Add the flour after the milk.
= kitchen | Cook the rice with the lid closed. | Leave the lid open when frying fish.
= kitchen | Do not open the oven while baking. | Keep the oven closed while baking.
= kitchen | Use no more than 2 spoons of sugar. | Use 1 spoon of sugar.
= kitchen | Cut pieces of 2 inches. | Cut pieces of 5 cm.
= kitchen | Fill the kettle between 30 and 80 %. | Fill the kettle to 50 %.
= kitchen | The hot pan needs a dry towel. | The cold pan needs no towel.
= kitchen | Rinse the rice in cold water. | Wash the greasy pan in hot water.
= kitchen | Make sure not to burn the garlic. | Fry the garlic gently.
= shell | Never run rm on the root folder. | Run rm on the build folder.
= shell | Set the timeout to 30 s for the login request. | Set the timeout to 5 s for the health probe.
= shell | Set the timeout to 30 s. | Set the timeout to 30000 ms.
= shell | Enable logging in the proxy. | Disable colours in the proxy.
= shell | Start the database, then the server. | Stop the server, then the database.
= shell | Use port 8080 for the proxy. | Use port 9090 for the database.
= shell | Don't hesitate to use sudo for package installs. | Use sudo for package installs.
= shell | Use at most 4 GB of memory for the build. | Use 2 GB of memory for the build.
= shell | Check disk space before the backup. | Check the archive after the backup.
= shell | Do not use cat for large files. | Use cat for small files.
= shell | Python 3.11 is needed by the service. | Node 20 is needed by the service.
= shell | Exit code 0 means the build passed. | Exit code 137 means the build ran out of memory.
= code | Indent the Makefile with tabs. | Indent Python with spaces.
= code | Do not commit secrets. | Commit the lock file.
= code | Retry the request 3 times. | Wait 10 seconds between requests.
= code | Validate the input before parsing it. | Parse the input after validating it.
= code | There is no need to rebuild the index. | The index is rebuilt automatically.
= code | Keep lines at most 100 characters long. | Keep lines at most 99 characters long.
= code | Add the import at the top of the module. | Add the changelog entry at the bottom of the file.
= code | Not only the unit tests but also the linter must pass. | The unit tests and the linter must pass.
= code | Fix line 42 of parser.py. | Fix line 97 of lexer.py.
= code | Use a left join for optional rows. | Use an inner join for required rows.
= code | Set the learning rate to 0.001 for fine-tuning. | Set the batch size to 64 for fine-tuning.
= code | Open the file in binary mode. | Close the file in the finally block.
= code | If the cache is disabled, read from disk. | If the cache is enabled, read from memory.
= home | Turn on the heating in winter. | Turn off the heating in summer.
= home | Water the cactus every 14 days. | Water the fern every 2 days.
= home | Do not forget to turn off the stove. | Turn off the stove.
= home | Tighten the upper screw. | Loosen the lower screw.
= home | Set the thermostat to 20 degrees. | Set the thermostat between 18 and 21 degrees.
= german | Hebe die Tasse 15 cm an. | Hebe den Teller 5 cm an.
= german | Hebe die Tasse mindestens 5 cm an. | Hebe die Tasse 15 cm an.
= german | Vergiss nicht, den Greifer zu öffnen. | Öffne den Greifer.
= german | Öffne die linke Tür. | Öffne die rechte Tür.
= german | Drehe den Deckel nach links. | Drehe den Knopf nach rechts.
= german | Die Probe vor der Messung kühlen. | Die Probe nach der Messung entsorgen.
= german | Drücke nicht auf das Glas. | Drücke auf den Knopf.
= french | Tournez la vis vers la gauche. | Tournez le bouton vers la droite.
= french | N'oubliez pas de fermer la porte. | Fermez la porte.
= french | Soulevez la boîte de 20 cm. | Soulevez la boîte de 200 mm.
= spanish | Empuja la caja hacia la izquierda. | Empuja el vaso hacia la derecha.
= spanish | No olvides abrir la pinza. | Abre la pinza.
= chinese | 向左推盒子。 | 向右推杯子。
= chinese | 别忘了打开夹爪。 | 打开夹爪。
= chinese | 把杯子抬高15厘米。 | 把杯子抬高150毫米。
"""


@dataclass(frozen=True)
class Pair:
    """Two lessons and whether they contradict each other."""

    conflict: bool
    domain: str
    first: str
    second: str
    held_out: bool


def pairs() -> list[Pair]:
    """All pairs, in the order in which they were written."""
    found: list[Pair] = []
    for line in _PAIRS.strip().split("\n"):
        domain, first, second = (part.strip() for part in line[1:].split("|"))
        before = sum(pair.conflict == (line[0] == "!") for pair in found)
        found.append(Pair(line[0] == "!", domain, first, second, held_out=before % 2 == 1))
    return found
