# SPDX-License-Identifier: Apache-2.0
# godot --path FOLDER -s tools.gd: describes Godot 4's import of the scene.glb next to this script.
#
# job.json has seconds (the time in the animation), rays (name to {from, along}, in Godot's world with y up, in metres),
# drops (name to {from, wheel}: a box of 0.4 m, or a wheel of radius 0.3 m and width 0.2 m, let fall for three seconds),
# and for a picture also picture (a file), eye and target. Writes found.json: all nodes with kinds, extras and positions at
# that time, the animations, the first hit of each ray, and where bodies rest.
extends SceneTree

func list(node: Node, nodes: Array, parent: String) -> void:
	var shapes := []
	for child in node.get_children():
		if child is CollisionShape3D:
			shapes.append(child.shape.get_class())
	var extras = node.get_meta("extras") if node.has_meta("extras") else null
	var at = node.global_position if node is Node3D else Vector3.ZERO
	nodes.append({"name": str(node.name), "parent": parent, "kind": node.get_class(), "extras": extras, "shapes": shapes, "at": [at.x, at.y, at.z]})
	for child in node.get_children():
		list(child, nodes, str(node.name))

func vector(values: Array) -> Vector3:
	return Vector3(values[0], values[1], values[2])

func body(drop: Dictionary) -> RigidBody3D:
	var rigid := RigidBody3D.new()
	var holder := CollisionShape3D.new()
	if drop["wheel"]:
		holder.shape = CylinderShape3D.new()
		holder.shape.radius = 0.3
		holder.shape.height = 0.2
		holder.rotation.x = PI / 2
	else:
		holder.shape = BoxShape3D.new()
		holder.shape.size = 0.4 * Vector3.ONE
	rigid.add_child(holder)
	rigid.position = vector(drop["from"])
	return rigid

func _initialize() -> void:
	run()

func run() -> void:
	var job: Dictionary = JSON.parse_string(FileAccess.get_file_as_string("res://job.json"))
	var scene: Node = load("res://scene.glb").instantiate()
	root.add_child(scene)
	await process_frame
	var found := {"version": Engine.get_version_info()["string"], "nodes": [], "hits": {}, "animations": []}
	for player in scene.find_children("*", "AnimationPlayer"):
		found["animations"] = Array(player.get_animation_list())
		player.play(player.get_animation_list()[0])
		player.pause()
		player.seek(job["seconds"], true)
	for i in 4:
		await physics_frame
	list(scene, found["nodes"], "")
	var space = root.get_world_3d().direct_space_state
	for name in job["rays"]:
		var from := vector(job["rays"][name]["from"])
		var hit = space.intersect_ray(PhysicsRayQueryParameters3D.create(from, from + 1000 * vector(job["rays"][name]["along"])))
		found["hits"][name] = null
		if hit:
			var owner_of = hit["collider"].get_parent()
			found["hits"][name] = {"name": str(owner_of.name), "body": hit["collider"].get_class(), "distance": from.distance_to(hit["position"])}
	var bodies := {}
	for name in job["drops"]:
		bodies[name] = body(job["drops"][name])
		root.add_child(bodies[name])
	for i in (180 if bodies else 0):
		await physics_frame
	found["rests"] = {}
	for name in bodies:
		found["rests"][name] = bodies[name].global_position.y
		bodies[name].free()
	if job.has("picture"):
		var camera := Camera3D.new()
		root.add_child(camera)
		camera.look_at_from_position(vector(job["eye"]), vector(job["target"]))
		camera.make_current()
		var sun := DirectionalLight3D.new()
		root.add_child(sun)
		sun.look_at_from_position(Vector3(3, 10, 6), Vector3.ZERO)
		var sky := WorldEnvironment.new()
		sky.environment = Environment.new()
		sky.environment.background_mode = Environment.BG_COLOR
		sky.environment.background_color = Color(0.75, 0.8, 0.85)
		sky.environment.ambient_light_source = Environment.AMBIENT_SOURCE_COLOR
		sky.environment.ambient_light_color = Color.WHITE
		sky.environment.ambient_light_energy = 1.5
		root.add_child(sky)
		root.size = Vector2i(640, 360)
		for i in 4:
			await process_frame
		root.get_texture().get_image().save_jpg(job["picture"], 0.8)
	FileAccess.open("res://found.json", FileAccess.WRITE).store_string(JSON.stringify(found))
	quit()
